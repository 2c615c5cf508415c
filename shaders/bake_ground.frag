#version 330 core
// Bakes elevation tint times light from the full-resolution terrain into one RGBA8 texel per post
// (Doellner's topographic texture); alpha 0 marks posts without data. With LIGHT the light alone as well, relative to
// that on level ground, for images laid over the ground.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/light.glsl"

uniform sampler2D u_palette;      // tints from lowest to highest; row 0 gentle, row 1 steep ground
#ifdef HOLES
uniform sampler2D u_source;       // R8: 1 where the post holds data
#endif
uniform vec4 u_tint_range;        // x: lowest [m], y: 1 / height span of the palette [1/m]
layout(location = 0) out vec4 out_colour;
#ifdef LIGHT
layout(location = 1) out vec4 out_light;
const float STRENGTH = 0.7;       // images hold light of their own, and colours of a legend must stay what they are
#endif

void main() {
    ivec2 post = ivec2(gl_FragCoord.xy);
    float height_m = post_height(post);
    float east_m = post_height(post + ivec2(1, 0)), west_m = post_height(post - ivec2(1, 0));
    float south_m = post_height(post + ivec2(0, 1)), north_m = post_height(post - ivec2(0, 1));
    vec2 slope = vec2(east_m - west_m, south_m - north_m) / (2.0 * u_grid.zw);
    vec3 normal = ground_normal(slope);

    // Crests stand out drier and stonier, hollows hold what grows and what falls; true slope, not the exaggerated one.
    float bend = (0.25 * (east_m + west_m + south_m + north_m) - height_m) / (u_grid.z * u_contour.w);
    float steep = length(slope) / u_contour.w;
    float rocky = smoothstep(0.55, 1.0, steep - 2.0 * bend);
    float tint = (height_m - u_tint_range.x) * u_tint_range.y + clamp(-0.35 * bend, -0.05, 0.05);
    vec3 albedo = mix(texture(u_palette, vec2(tint, 0.25)).rgb, texture(u_palette, vec2(tint, 0.75)).rgb, rocky);

    vec3 light = ground_light(normal, gl_FragCoord.xy / u_grid.xy);
    vec3 colour = display_colour(albedo * albedo * light);
#ifdef HOLES
    out_colour = vec4(colour, texelFetch(u_source, post, 0).r);
#else
    out_colour = vec4(colour, 1.0);
#endif
#ifdef LIGHT
    out_light = vec4(0.5 * sqrt(mix(vec3(1.0), light / level_light(), STRENGTH)), 1.0);
#endif
}
