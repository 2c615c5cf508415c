#version 330 core
// An edge of a bounding box.
#include "lib/frame.glsl"
#include "lib/depth.glsl"
#include "lib/debug.glsl"

noperspective in float v_across_px;
flat in float v_level;
uniform float u_line_width_px;
uniform float u_opacity;
out vec4 out_colour;

void main() {
    float cover = clamp(0.5 * u_line_width_px + 0.5 - abs(v_across_px), 0.0, 1.0);
    out_colour = vec4(level_colour(v_level), u_opacity * cover);
#ifdef LOG_DEPTH
    gl_FragDepth = depth_at(0.999 / gl_FragCoord.w);
#endif
}
