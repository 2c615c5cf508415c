#version 330 core
// A level water surface, blended over the terrain: found along each sight ray, so that it reaches the horizon and its
// depth is exact. Shallow water lets the ground through; the steeper one looks down, the less of the sky it mirrors.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/depth.glsl"
#include "lib/atmosphere.glsl"

#ifdef HOLES
uniform sampler2D u_ground;
#endif
in vec2 v_screen;
out vec4 out_colour;

// Depth of the water [m] above the ground at a post; ground without data and beyond the grid counts as deep. So does
// ground well above the water: it hides that, unless one looks in below the terrain's edge.
float water_depth(vec2 post) {
    float deep_m = 4.0 * u_water.y;
    if (any(lessThan(post, vec2(0.0))) || any(greaterThan(post, u_grid.xy - 1.0))) return deep_m;
    float depth_m = u_water.x - surface_height(post);
    depth_m = mix(max(depth_m, 0.0), deep_m, smoothstep(1.0, 2.0, -depth_m / u_water.y));
#ifdef HOLES
    depth_m = mix(deep_m, depth_m, smoothstep(0.2, 0.9, textureLod(u_ground, (post + 0.5) / u_grid.xy, 0.0).a));
#endif
    return depth_m;
}

void main() {
    vec3 sight = sight_ray(v_screen);
    float view_depth_m = height_from_eye(u_water.x) / sight.y;
    if (!(view_depth_m > u_eye_height.z && view_depth_m < 1e8)) discard;
    vec3 position_m = sight * view_depth_m;
    vec3 ray = normalize(sight);
    float down = abs(ray.y);

    float fresnel = 0.02 + 0.98 * pow(1.0 - down, 5.0);  // Schlick, water to air
    vec3 mirrored = vec3(ray.x, down, ray.z);
    vec3 sky = sky_colour(mirrored) + u_sunlight.rgb * 0.5 * pow(max(dot(mirrored, u_sun.xyz), 0.0), 400.0);
    float light = dot(u_sunlight.rgb * u_sun.y + u_sky_light.rgb, vec3(0.33));
    float thickness = water_depth(post_of(position_m)) / (u_water.y * mix(0.35, 1.0, down));
    float opaque = 1.0 - exp(-2.0 * thickness);
    vec3 body = mix(vec3(0.30, 0.50, 0.50), vec3(0.07, 0.20, 0.30), opaque) * sqrt(light);
    vec3 colour = mix(body, sky, fresnel);
#ifdef FOG
    colour = apply_fog(colour, position_m);
#endif
    // The shore itself has no edge: the first hand's breadth of water is clear.
    float alpha = max(opaque * 0.97, fresnel) * smoothstep(0.0, 0.06, thickness);
    out_colour = vec4(colour, alpha);
    gl_FragDepth = depth_at(view_depth_m);
}
