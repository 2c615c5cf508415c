#version 330 core
// Walls that close the gap between two patches of Doellner's approximation tree.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"
#include "lib/gouraud.glsl"

in vec4 in_corner;  // xy: post (col, row); z: height [m]; w: 1 to 4, facing N, S, W, E, negative on the lower edge
in float in_above;  // the vertex lies this far above that height [m]
uniform int u_stride;

// A little overlap [px] up and down, and to the sides, so that the wall is no line seen from above: the picture rounds
// vertices, and leaves no pixel between wall and edge.
const float OVERLAP = 0.01;
const vec2 FACING[5] = vec2[](vec2(0.0), vec2(0.0, -1.0), vec2(0.0, 1.0), vec2(-1.0, 0.0), vec2(1.0, 0.0));

void main() {
    vec2 post = in_corner.xy * float(u_stride);
    vec3 position = position_of(post, in_corner.z);
    position.y += in_above;
    float reach = sign(in_corner.w) * OVERLAP * length(position) / u_eye_height.w;
    position.y += reach;
    position.xz -= reach * FACING[int(abs(in_corner.w) + 0.5)];
    emit_surface(position, post, 0.0);
    emit_light(post);
}
