// Fragment stage: what a point of the surface writes. Exactly one OUTPUT_ switch is defined (terrain/frame.py: Output).
// Include after lib/frame.glsl. The only entry point is write_surface.
#include "lib/needs.glsl"
#include "lib/depth.glsl"

#if defined(OUTPUT_SHADED)
#include "lib/shade.glsl"
#elif defined(HOLES) || defined(OUTPUT_LEVELS)
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

// position_m: relative to the eye (only read where NEEDS_POSITION); ground: coordinate of the ground textures.
void write_surface(vec3 position_m, vec2 ground, float level) {
#if (defined(HOLES) || defined(OUTPUT_LEVELS)) && !defined(OUTPUT_SHADED)
    vec4 baked = textureLod(u_ground, ground, 0.0);
#endif
#if defined(HOLES) && !defined(OUTPUT_SHADED)
    if (baked.a < 0.5) discard;
#endif
#if defined(OUTPUT_SHADED)
    out_colour = shade(position_m, ground);
#elif defined(OUTPUT_POSITION)
#ifdef RASTERISED
    // How far the point moves across a pixel [m]: what rounded corners may have shifted it (measure_error.frag).
    out_colour = vec4(position_m, 1.0 + length(dFdx(position_m)) + length(dFdy(position_m)));
#else
    out_colour = vec4(position_m, 1.0);
#endif
#elif defined(OUTPUT_LEVELS)
    // The baked light stays visible below the colour, so that the shape can still be read.
    out_colour = vec4(level_colour(level) * (0.35 + dot(baked.rgb, vec3(0.3, 0.7, 0.2))), 1.0);
#elif defined(OUTPUT_NORMALS)
    out_colour = vec4(normal_colour(position_m), 1.0);
#elif defined(OUTPUT_OVERDRAW)
    out_count = 1.0;
#elif defined(OUTPUT_FLAT)
    out_colour = vec4(1.0);  // the mark of a line; view_wires.frag makes it visible
#endif
}
