#version 330 core
// A line with soft edges.
#include "lib/frame.glsl"
#include "lib/depth.glsl"

noperspective in float v_across_px;
uniform vec4 u_line_colour;
uniform float u_line_width_px;
out vec4 out_colour;

void main() {
    float cover = clamp(0.5 * u_line_width_px + 0.5 - abs(v_across_px), 0.0, 1.0);
    out_colour = vec4(u_line_colour.rgb, u_line_colour.a * cover);
#ifdef LOG_DEPTH
    gl_FragDepth = depth_at(0.999 / gl_FragCoord.w);
#endif
}
