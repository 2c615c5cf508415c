#version 330 core
// Fragment stage of the debug picture (figure 4).
#include "lib/frame.glsl"
#include "lib/depth.glsl"
#include "lib/debug.glsl"

in vec4 v_paint;  // rgb: light; a: level whose colour it falls on
out vec4 out_colour;

void main() {
    out_colour = vec4(v_paint.rgb * level_colour(floor(v_paint.a + 0.5)), 1.0);
#ifdef LOG_DEPTH
    gl_FragDepth = depth_at(1.0 / gl_FragCoord.w);
#endif
}
