#version 330 core
// How much of the sky (r, with SKY) or of the sun (g) a place sees past the terrain around it, on the coarse heights:
// marches outwards and keeps the highest elevation angle met. The colour mask keeps the other channel.
#include "lib/frame.glsl"

uniform sampler2D u_coarse;
uniform vec4 u_coarse_size;  // xy: texels; zw: posts per texel
uniform vec4 u_height_range; // x: lowest, y: highest [m]
out vec4 out_visibility;

const int SKY_DIRECTIONS = 8;
const int SKY_STEPS = 6;
const int SUN_STEPS = 28;
const float PENUMBRA = 0.035;  // softens the edge of cast shadows [tangent]; the sun itself is 0.009 wide

float coarse_height(vec2 texel, float lod) {
    return textureLod(u_coarse, texel / u_coarse_size.xy, lod).r;
}

void main() {
    vec2 texel_m = u_coarse_size.zw * u_grid.zw;
    vec2 here = gl_FragCoord.xy;
    float height_m = coarse_height(here, 0.0);
    float cell_m = min(texel_m.x, texel_m.y);

#ifdef SKY
    // a horizontal receiver sees cos^2 of the horizon's elevation in each azimuth.
    float open = 0.0;
    for (int i = 0; i < SKY_DIRECTIONS; i++) {
        float azimuth = (float(i) + 0.5) * 6.2831853 / float(SKY_DIRECTIONS);
        vec2 way = vec2(sin(azimuth), cos(azimuth));
        float steepest = 0.0;
        float reach_m = 1.5 * cell_m;
        for (int k = 0; k < SKY_STEPS; k++) {
            float rise_m = coarse_height(here + way * reach_m / texel_m, max(float(k) * 0.8 - 1.0, 0.0)) - height_m;
            steepest = max(steepest, rise_m / reach_m);
            reach_m *= 1.9;
        }
        open += 1.0 / (1.0 + steepest * steepest);
    }
    out_visibility = vec4(open / float(SKY_DIRECTIONS), 0.0, 0.0, 1.0);
#else
    // By how much the ground rises above the ray towards it.
    float climb = u_sun.y / max(length(u_sun.xz), 1e-4);
    vec2 way = u_sun.xz / max(length(u_sun.xz), 1e-4);
    float far_m = min((u_height_range.y - height_m) / max(climb, 0.02), 240.0 * cell_m);
    float above = -1.0;
    for (int k = 0; k < SUN_STEPS; k++) {
        float t = (float(k) + 1.0) / float(SUN_STEPS);
        float reach_m = 1.2 * cell_m + far_m * t * t;
        float lod = max(log2(2.0 * far_m * t / (float(SUN_STEPS) * cell_m)) - 1.0, 0.0);
        above = max(above, (coarse_height(here + way * reach_m / texel_m, lod) - height_m) / reach_m - climb);
    }
    out_visibility = vec4(0.0, 1.0 - smoothstep(-PENUMBRA, PENUMBRA, above), 0.0, 1.0);
#endif
}
