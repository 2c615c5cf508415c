// Light on the ground, linear, for everything that is baked. Include after lib/frame.glsl.
uniform sampler2D u_visibility;  // r: share of the sky seen, g: share of the sun seen (bake_visibility.frag)

// slope: height gained per metre east (x) and south (y).
vec3 ground_normal(vec2 slope) {
    return normalize(vec3(-slope.x, 1.0, -slope.y));
}

vec3 ground_light(vec3 normal, vec2 ground) {
    vec2 seen = texture(u_visibility, ground).rg;
    float facing = max(dot(normal, u_sun.xyz), 0.0) * seen.g;
    float bounce = 0.25 * (1.0 - normal.y) + 0.06;  // light from the ground opposite
    return u_sunlight.rgb * (facing + bounce * u_sun.y)
           + u_sky_light.rgb * (0.5 + 0.5 * normal.y) * (seen.r * seen.r);
}

// Linear to display: a shoulder keeps snow in the sun from burning out.
vec3 display_colour(vec3 linear) {
    return sqrt(linear / (1.0 + 0.15 * linear * linear));
}
