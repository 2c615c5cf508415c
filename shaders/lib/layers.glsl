// Layers over the ground, combined for each pixel; twin of compose in terrain/textures/layers.py. What no layer uses is
// not compiled. Include after lib/frame.glsl.
#if LAYERS > 0
#include "lib/pages.glsl"

uniform sampler2D u_light;  // light relative to that on level ground, half of it (bake_ground.frag)
#endif

const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
const float MIX = 0.0, MODULATE = 1.0, ADD = 2.0;  // as in BLENDS

#ifdef LENS
// 1 inside the lens, 0 outside, smooth over its rim.
float inside_lens(vec2 ground) {
    float away_m = length((ground - u_lens.xy) * u_grid.xy * u_grid.zw);
    return 1.0 - smoothstep(u_lens.z - u_lens.w, u_lens.z, away_m);
}
#endif

vec3 compose_layers(vec3 colour, vec2 ground) {
#ifdef LENS
    float inside = inside_lens(ground);
#endif
#if LAYERS > 0
    vec3 light = 2.0 * texture(u_light, ground).rgb;
    for (int i = 0; i < LAYERS; ++i) {
        vec4 what = u_layer_what[i], how = u_layer_how[i];
        vec4 image = sample_tree(int(what.x), ground);
#ifdef KEY_FRAMES
        if (what.z > 0.0) image = mix(image, sample_tree(int(what.y), ground), what.z);
#endif
        float weight = how.x;
#ifdef LENS
        weight *= mix(how.z, how.w, inside);
#endif
#ifdef VISIBILITY
        if (what.w >= 0.0) weight *= dot(sample_tree(int(what.w), ground).rgb, LUMINANCE);
#endif
        vec3 gain = how.y == MODULATE ? colour : how.y == MIX ? light : vec3(1.0);
        float keep = how.y == ADD ? 1.0 : 1.0 - weight * image.a;
        colour = clamp(colour * keep + gain * image.rgb * weight, 0.0, 1.0);
    }
#endif
#ifdef LENS
    colour *= 1.0 - u_lens_effect.x * (1.0 - inside);
#endif
    return colour;
}
