#version 330 core
// The fragment stage of every renderer that draws triangles.
#define RASTERISED  // triangles, whose corners the hardware rounds to a fraction of a pixel
#include "lib/frame.glsl"
#include "lib/output.glsl"

in vec2 v_ground;
#if defined(POSITION_VARYING)
in vec3 v_position_m;
#elif defined(POSITION_FROM_DEPTH)
// 1 / gl_FragCoord.w is the view depth, and the sight ray is as long as view depth 1
#define v_position_m (sight_ray(gl_FragCoord.xy * u_viewport.zw) / gl_FragCoord.w)
#elif defined(DISTANCE_FROM_DEPTH)
#define v_position_m vec3(0.0, 0.0, sight_length(gl_FragCoord.xy * u_viewport.zw) / gl_FragCoord.w)  // as far away
#else
const vec3 v_position_m = vec3(0.0);
#endif
#ifdef OUTPUT_LEVELS
in float v_level;
#else
const float v_level = 0.0;
#endif

void main() {
    write_surface(v_position_m, v_ground, v_level);
#ifdef LOG_DEPTH
#ifdef OUTPUT_FLAT
    gl_FragDepth = depth_at(0.998 / gl_FragCoord.w);  // polygon offset does not reach a depth that is written
#else
    gl_FragDepth = depth_at(1.0 / gl_FragCoord.w);
#endif
#endif
}
