#version 330 core
// Slices of Roettger and Ertl's adaptive slicing: one instance per slice, made from the small record of its box.
#include "lib/frame.glsl"
#include "lib/packed.glsl"
#include "lib/slices.glsl"

in uint in_slice;
out vec3 v_at;  // posts from the eye in x and z, metres above it in y
flat out uint v_slice;

void main() {
    Bundle bundle = bundle_of(in_slice);
    int axis;
    float plane;
    plane_of(bundle, in_slice, axis, plane);
    int across = axis == 0 ? 2 : 0, along = axis == 1 ? 2 : 1;
    vec3 low = bundle.lower - bundle.border, high = bundle.upper + bundle.border, position;
    position[axis] = plane;
    position[across] = (gl_VertexID & 1) == 0 ? low[across] : high[across];
    position[along] = gl_VertexID < 2 ? low[along] : high[along];
    v_at = vec3(posts_from_eye(position), position.y).xzy;
    v_slice = in_slice;
    gl_Position = u_clip_from_eye * vec4(position, 1.0);
}
