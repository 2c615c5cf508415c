#version 330 core
// Coarse heights for large-scale light: each texel is the mean of posts spread over its area.
#include "lib/frame.glsl"
#include "lib/surface.glsl"

uniform vec4 u_coarse_size;  // xy: texels; zw: posts per texel
out float out_height_m;

void main() {
    vec2 corner = (gl_FragCoord.xy - 0.5) * u_coarse_size.zw;
    float sum = 0.0;
    for (int i = 0; i < 9; i++) {
        vec2 within = (vec2(i % 3, i / 3) + 0.5) / 3.0;
        sum += post_height(ivec2(corner + within * u_coarse_size.zw));
    }
    out_height_m = sum / 9.0;
}
