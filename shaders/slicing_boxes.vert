#version 330 core
// Sliced boxes of the debug picture (figure 4), drawn as boxes in the colour of their bundle's direction.
#include "lib/frame.glsl"
#include "lib/slices.glsl"

in uint in_slice;
out vec4 v_paint;  // rgb: light of the face; a: bundle direction

// Four vertices per face, a strip; faces in the order x low, x high, y low ... z high.
void main() {
    Bundle bundle = bundle_of(in_slice);
    int axis;
    float plane;
    plane_of(bundle, in_slice, axis, plane);
    int across = axis == 0 ? 2 : 0, along = axis == 1 ? 2 : 1;
    vec3 position;
    position[axis] = plane;
    position[across] = (gl_VertexID & 1) == 0 ? bundle.lower[across] : bundle.upper[across];
    position[along] = gl_VertexID < 2 ? bundle.lower[along] : bundle.upper[along];
    v_paint = vec4(vec3(axis == 1 ? 1.0 : axis == 0 ? 0.75 : 0.55), float(bundle.axis + 1));
    gl_Position = u_clip_from_eye * vec4(position, 1.0);
}
