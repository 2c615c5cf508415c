#version 330 core
// Slices of Roettger and Ertl's adaptive slicing: one instance per slice, made from the small record of its box.
#include "lib/frame.glsl"
#include "lib/slices.glsl"

in uint in_slice;
uniform vec4 u_posts_from_m;
flat out vec4 v_planes;  // lib/bundle.glsl
flat out vec3 v_enter;

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
    vec3 posts = vec3(u_posts_from_m.x, 1.0, u_posts_from_m.y);
    float step = (bundle.far - bundle.near) / bundle.count;
    v_planes = vec4(vec2(bundle.near, step) * posts[bundle.axis], 1.0 / (step * posts[bundle.axis]), float(bundle.axis));
    v_enter = (max(bundle.lower, 0.0) + min(bundle.upper, 0.0)) * posts;
    gl_Position = u_clip_from_eye * vec4(position, 1.0);
}
