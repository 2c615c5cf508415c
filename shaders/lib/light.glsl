// Light on the ground, linear, for everything that is baked: one of the design rules of terrain/textures/baking.py.
// Include after lib/frame.glsl.
uniform sampler2D u_visibility;  // r: share of the sky seen, g: share of the sun seen (bake_visibility.frag)

// slope: height gained per metre east (x) and south (y).
vec3 ground_normal(vec2 slope) {
    return normalize(vec3(-slope.x, 1.0, -slope.y));
}

#if defined(RULE_HILLSHADE) || defined(RULE_SLOPE)
const float MAP_LIGHT = 1.12;  // white light that shows tints as they are printed

vec3 level_light() {
    return vec3(MAP_LIGHT);
}
#else
vec3 level_light() {
    return u_sunlight.rgb * (1.06 * u_sun.y) + u_sky_light.rgb;
}
#endif

#if defined(RULE_HILLSHADE)
// Four lights from the sun's side, an eighth of a turn apart, 30 degrees high. Each counts by the square of the sine
// between its azimuth and the slope's, so that a ridge is modelled by the light that falls along it (Mark, 1992). Deep
// valleys, which see little of the sky, stay darker than ridges.
vec3 ground_light(vec3 normal, vec2 ground) {
    const vec2 ALTITUDE = vec2(0.8660254, 0.5);  // cosine, sine
    vec2 towards = normalize(u_sun.xz + vec2(0.0, -1e-6)), facing = normal.xz + vec2(0.0, 1e-9);
    facing /= length(facing);
    mat2 eighth = mat2(0.70710678, 0.70710678, -0.70710678, 0.70710678);
    vec2 azimuth = eighth * towards;
    float shade = 0.0;
    for (int i = 0; i < 4; i++) {
        float across = azimuth.x * facing.y - azimuth.y * facing.x;
        shade += across * across * max(dot(normal, vec3(azimuth.x * ALTITUDE.x, ALTITUDE.y, azimuth.y * ALTITUDE.x)), 0.0);
        azimuth = azimuth * eighth;  // backwards: to the left of the sun
    }
    shade /= 2.0 * ALTITUDE.y;  // the four weights add up to 2; level ground gets 1
    float seen = texture(u_visibility, ground).r, contrast = shade * sqrt(shade);  // four lights at once are soft
    return vec3(MAP_LIGHT * (0.08 + 0.92 * contrast) * mix(1.0, seen * seen, 0.6));
}
#elif defined(RULE_SLOPE)
vec3 ground_light(vec3 normal, vec2 ground) {
    return vec3(MAP_LIGHT * normal.y * normal.y);
}
#else
vec3 ground_light(vec3 normal, vec2 ground) {
    vec2 seen = texture(u_visibility, ground).rg;
    float facing = max(dot(normal, u_sun.xyz), 0.0) * seen.g;
    float bounce = 0.25 * (1.0 - normal.y) + 0.06;  // light from the ground opposite
    return u_sunlight.rgb * (facing + bounce * u_sun.y)
           + u_sky_light.rgb * (0.5 + 0.5 * normal.y) * (seen.r * seen.r);
}
#endif

// Linear to display: a shoulder keeps snow in the sun from burning out.
vec3 display_colour(vec3 linear) {
    return sqrt(linear / (1.0 + 0.15 * linear * linear));
}
