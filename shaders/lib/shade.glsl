// The look of the surface, shared by all renderers. Elevation tint times light is baked from the full-resolution
// terrain (bake_ground.frag), so that light does not change with the level of detail. What is switched off in the look
// is not compiled (terrain/textures/look.py). Include after lib/frame.glsl.
#include "lib/atmosphere.glsl"

uniform sampler2D u_ground;  // tint times light; alpha 0 where there is no data

#ifdef LAYERS
#include "lib/layers.glsl"
#endif

#ifdef CONTOURS
// How much of a pixel lines of equal height cover. The line through f = 0 has the same width in pixels everywhere;
// lines closer than a few pixels fade into their average.
float contour_cover(float f, float per_px, float width_px) {
    float off_px = abs(fract(f + 0.5) - 0.5) / per_px;
    float line = clamp(0.5 * width_px + 0.5 - off_px, 0.0, 1.0);
    return mix(line, 0.0, smoothstep(0.12, 0.4, per_px));
}

vec3 draw_contours(vec3 colour, vec3 position_m) {
    float f = height_of(position_m.y) / u_contour.x;
    float per_px = max(length(vec2(dFdx(position_m.y), dFdy(position_m.y))) / u_contour.x, 1e-6);
    float cover = max(0.55 * contour_cover(f, per_px, u_contour.z),
                      0.85 * contour_cover(f / u_contour.y, per_px / u_contour.y, 1.7 * u_contour.z));
    return mix(colour, vec3(0.16, 0.10, 0.06), cover);
}
#endif

vec4 shade(vec3 position_m, vec2 ground) {
    vec4 baked = texture(u_ground, ground);
    vec3 colour = baked.rgb;
#ifdef LAYERS
    colour = compose_layers(colour, ground);
#endif
#ifdef CONTOURS
    colour = draw_contours(colour, position_m);
#endif
#ifdef FOG
    colour = apply_fog(colour, position_m);
#endif
#ifdef HOLES
    if (baked.a < 0.5) discard;
#endif
    return vec4(colour, 1.0);
}
