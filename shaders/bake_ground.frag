#version 330 core
// Bakes elevation tint times light from the full-resolution terrain into one RGBA8 texel per post
// (Doellner's topographic texture); alpha 0 marks posts without data.
#include "lib/frame.glsl"
#include "lib/surface.glsl"

uniform sampler2D u_palette;      // elevation tints, lowest to highest, one row
uniform sampler2D u_source;       // R8: 1 where the post holds data
uniform vec4 u_tint_range;        // x: lowest, y: 1 / (highest - lowest) [m]
out vec4 out_colour;

void main() {
    ivec2 post = ivec2(gl_FragCoord.xy);
    float height_m = post_height(post);
    vec2 slope = vec2(post_height(post + ivec2(1, 0)) - post_height(post - ivec2(1, 0)),
                      post_height(post + ivec2(0, 1)) - post_height(post - ivec2(0, 1))) / (2.0 * u_grid.zw);
    vec3 normal = normalize(vec3(-slope.x, 1.0, -slope.y));
    float sun = max(dot(normal, u_sun.xyz), 0.0) * u_sun.w;
    float sky = 0.5 + 0.5 * normal.y;
    vec3 tint = texture(u_palette, vec2((height_m - u_tint_range.x) * u_tint_range.y, 0.5)).rgb;
    vec3 light = sun * vec3(1.0, 0.95, 0.86) * 0.95 + sky * vec3(0.42, 0.5, 0.62) * 0.7;
    out_colour = vec4(tint * light, texelFetch(u_source, post, 0).r);
}
