// Sky and haze, in display colours. Include after lib/frame.glsl.

// Colour of the sky along a unit ray: pale at the horizon, deep at the zenith, warm around the sun; below it haze, the
// darker the steeper one looks down, so that the terrain stands out.
vec3 sky_colour(vec3 ray) {
    float towards_sun = max(dot(ray, u_sun.xyz), 0.0);
    vec3 glow = u_sunlight.rgb * (0.05 * pow(towards_sun, 8.0) + 0.10 * pow(towards_sun, 64.0));
    vec3 above = mix(u_horizon.rgb, u_zenith.rgb, 1.0 - exp2(-4.5 * max(ray.y, 0.0)));
    vec3 below = u_fog_colour.rgb * (1.0 + vec3(0.45, 0.36, 0.26) * min(ray.y, 0.0));
    return mix(above, below, smoothstep(0.0, 0.12, -ray.y)) + glow;
}

#ifdef FOG
// exp(-x) to half a level of a display colour: seven multiplications in place of a general exponential.
float transmission(float x) {
    float y = min(0.125 * x, 1.0);
    float part = 1.0 - y + 0.5 * y * y;
    part *= part;
    part *= part;
    return part * part;
}

// Haze between the eye and a point, of the colour of the sky at the horizon. It costs a software rasteriser as much as
// all other shading, so it is one exponential: the same at every height, unless the look asks for more. What the eye's
// own height takes away from it is a constant of the frame (terrain/gpu/frame_block.py).
vec3 apply_fog(vec3 colour, vec3 position_m) {
    float distance_m = length(position_m);
#ifdef HEIGHT_FOG
    // The integral of a density that falls off exponentially with height:
    // distance * (density_eye - density_point) / (falloff * rise).
    float x = u_fog.z * position_m.y;
    float at_point = u_fog.x * exp(-u_fog.z * max(height_of(position_m.y) - u_fog.y, 0.0));
    float density = abs(x) < 1e-2 ? 0.5 * (u_fog.w + at_point) : (u_fog.w - at_point) / x;
    return mix(u_horizon.rgb, colour, transmission(distance_m * max(density, 0.0)));
#else
    return mix(u_horizon.rgb, colour, transmission(distance_m * u_fog.x));
#endif
}
#endif
