#version 330 core
// Bakes a draped image times light, one texel per texel of the image. A photograph holds light of its own, so the
// terrain's is put on at part strength, relative to that of level ground.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/light.glsl"

uniform sampler2D u_source;        // the image, RGBA
uniform vec4 u_post_from_image[2]; // rows of the affine map from texture coordinates to posts
out vec4 out_colour;

const float STRENGTH = 0.7;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec4 image = texelFetch(u_source, texel, 0);
    vec3 place = vec3(gl_FragCoord.xy / vec2(textureSize(u_source, 0)), 1.0);
    vec2 post = vec2(dot(u_post_from_image[0].xyz, place), dot(u_post_from_image[1].xyz, place));
    vec2 inside = clamp(post, vec2(0.0), u_grid.xy - 1.0);
    vec2 low = clamp(inside - 1.0, vec2(0.0), u_grid.xy - 1.0), high = clamp(inside + 1.0, vec2(0.0), u_grid.xy - 1.0);
    vec2 slope = vec2(surface_height(vec2(high.x, inside.y)) - surface_height(vec2(low.x, inside.y)),
                      surface_height(vec2(inside.x, high.y)) - surface_height(vec2(inside.x, low.y)))
                 / ((high - low) * u_grid.zw);
    vec3 light = ground_light(ground_normal(slope), (post + 0.5) / u_grid.xy);
    vec3 level = u_sunlight.rgb * (1.06 * u_sun.y) + u_sky_light.rgb;
    vec3 relative = mix(vec3(1.0), light / level, STRENGTH);
    out_colour = vec4(image.rgb * sqrt(relative), image.a);
}
