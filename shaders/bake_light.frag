#version 330 core
// Bakes the light on images into one texel per post, as the factor of their colours, half of it to fit into 0..1. A
// photograph holds light of its own, so the terrain's is put on at part strength, relative to that of level ground.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/light.glsl"

out vec4 out_light;

const float STRENGTH = 0.7;
const float MOST_LIGHT = 2.0;  // as in lib/shade.glsl

void main() {
    ivec2 post = ivec2(gl_FragCoord.xy), last = ivec2(u_grid.xy) - 1;
    ivec2 low = max(post - 1, 0), high = min(post + 1, last);
    vec2 slope = vec2(post_height(ivec2(high.x, post.y)) - post_height(ivec2(low.x, post.y)),
                      post_height(ivec2(post.x, high.y)) - post_height(ivec2(post.x, low.y)))
                 / (vec2(high - low) * u_grid.zw);
    vec3 light = ground_light(ground_normal(slope), gl_FragCoord.xy / u_grid.xy);
    vec3 level = u_sunlight.rgb * (1.06 * u_sun.y) + u_sky_light.rgb;
    out_light = vec4(sqrt(mix(vec3(1.0), light / level, STRENGTH)) / MOST_LIGHT, 1.0);
}
