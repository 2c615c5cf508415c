// Fragment stage: what a point of the surface writes. Exactly one OUTPUT_ switch is defined (terrain/frame.py: Output).
// Include after lib/frame.glsl. The only entry point is write_surface.
#include "lib/needs.glsl"

#if defined(OUTPUT_SHADED)
#include "lib/shade.glsl"
#elif defined(HOLES)
uniform sampler2D u_ground;
#endif
#if defined(OUTPUT_LEVELS) || defined(OUTPUT_NORMALS)
#include "lib/debug.glsl"
#endif

#ifdef OUTPUT_OVERDRAW
out float out_count;
#else
out vec4 out_colour;
#endif

#ifdef LOG_DEPTH
// Depth of the same sense as reversed z (1 near, 0 far) for drivers without clip control: log2 of the distance
// between the near plane and 1e8 m.
float depth_of(vec3 position_m) {
    float w = max(dot(vec4(position_m, 1.0), vec4(u_clip_from_eye[0].w, u_clip_from_eye[1].w, u_clip_from_eye[2].w,
                  u_clip_from_eye[3].w)), u_eye_height.z);
    return 1.0 - log2(w / u_eye_height.z) / log2(1e8 / u_eye_height.z);
}
#else
// Reversed z: near / view depth.
float depth_of(vec3 position_m) {
    vec4 clip = u_clip_from_eye * vec4(position_m, 1.0);
    return clip.z / clip.w;
}
#endif

// position_m: relative to the eye (only read where NEEDS_POSITION); ground: coordinate of the ground textures.
void write_surface(vec3 position_m, vec2 ground, float level) {
#if defined(HOLES) && !defined(OUTPUT_SHADED)
    if (texture(u_ground, ground).a < 0.5) discard;
#endif
#if defined(OUTPUT_SHADED)
    out_colour = shade(position_m, ground);
#elif defined(OUTPUT_POSITION)
    out_colour = vec4(position_m, 1.0);
#elif defined(OUTPUT_LEVELS)
    out_colour = vec4(level_colour(level), 1.0);
#elif defined(OUTPUT_NORMALS)
    out_colour = vec4(normal_colour(position_m), 1.0);
#elif defined(OUTPUT_OVERDRAW)
    out_count = 1.0;
#elif defined(OUTPUT_FLAT)
    out_colour = vec4(0.02, 0.02, 0.04, 0.55);
#endif
}
