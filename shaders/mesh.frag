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
    float view_depth_m = 1.0 / gl_FragCoord.w;
#if defined(OUTPUT_FLAT)
    view_depth_m *= 0.9995;  // as in lib/emit.glsl
#elif defined(BELOW_LINES)
    // Polygon offset does not reach a depth that is written. So the ground gives way, by what depth changes in a pixel.
    view_depth_m += max(abs(dFdx(view_depth_m)), abs(dFdy(view_depth_m)));
#endif
    gl_FragDepth = depth_at(view_depth_m);
#endif
}
