#version 330 core
// The fragment stage of every renderer that draws triangles.
#include "lib/frame.glsl"
#include "lib/output.glsl"

in vec2 v_ground;
#ifdef NEEDS_POSITION
in vec3 v_position_m;
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
    // gl_FragCoord.w is 1 / clip w: the view depth
    gl_FragDepth = 1.0 - log2(max(1.0 / gl_FragCoord.w, u_eye_height.z) / u_eye_height.z) / log2(1e8 / u_eye_height.z);
#endif
}
