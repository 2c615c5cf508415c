#version 330 core
// Walls that close the gap between two patches of Doellner's approximation tree.
#include "lib/frame.glsl"
#include "lib/emit.glsl"

in vec4 in_corner;  // xy: post (col, row); z: height [m]; w: 1 on the upper edge, -1 on the lower
uniform int u_stride;

// The edges of the patches run past corners of the wall: a little overlap [px] leaves no pixel between.
const float OVERLAP = 0.05;

void main() {
    vec2 post = in_corner.xy * float(u_stride);
    vec3 position = position_of(post, in_corner.z);
    position.y += in_corner.w * OVERLAP * length(position) / u_eye_height.w;
    emit_surface(position, post, 0.0);
}
