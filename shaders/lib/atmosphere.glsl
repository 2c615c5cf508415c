// Sky and haze, in display colours. Include after lib/frame.glsl.

// Colour of the sky along a unit ray: pale at the horizon, deep at the zenith, warm around the sun; haze below.
vec3 sky_colour(vec3 ray) {
    float towards_sun = max(dot(ray, u_sun.xyz), 0.0);
    vec3 glow = u_sunlight.rgb * (0.05 * pow(towards_sun, 8.0) + 0.10 * pow(towards_sun, 64.0));
    vec3 above = mix(u_horizon.rgb, u_zenith.rgb, 1.0 - exp2(-4.5 * max(ray.y, 0.0)));
    return mix(above, u_fog_colour.rgb, smoothstep(0.0, 0.12, -ray.y)) + glow;
}

#ifdef FOG
// Haze between the eye and a point: the integral of a density that falls off exponentially with height, which is
// distance * (density_eye - density_point) / (falloff * rise). Its colour is that of the sky at the horizon.
vec3 apply_fog(vec3 colour, vec3 position_m) {
    float distance_m = length(position_m);
    float x = u_fog.z * position_m.y;
    float at_point = u_fog.x * exp(-u_fog.z * max(height_of(position_m.y) - u_fog.y, 0.0));
    float mean = abs(x) < 1e-2 ? 0.5 * (u_fog.w + at_point) : (u_fog.w - at_point) / x;
    float clear = exp(-distance_m * max(mean, 0.0));
    float towards_sun = max(dot(position_m, u_sun.xyz) / distance_m, 0.0);
    vec3 haze = u_horizon.rgb + u_sunlight.rgb * (0.05 * towards_sun * towards_sun * towards_sun);
    return mix(haze, colour, clear);
}
#endif
