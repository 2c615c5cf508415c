#version 330 core
// Lines in the world: one instance per segment, four corners of a strip.
#include "lib/frame.glsl"
#include "lib/line.glsl"

in vec3 in_from_m;  // relative to the eye
in vec3 in_to_m;
uniform float u_line_width_px;

void main() {
    emit_line(in_from_m, in_to_m, gl_VertexID, u_line_width_px);
}
