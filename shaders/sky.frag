#version 330 core
// The sky behind the terrain: a gradient by elevation and the sun's disc.
#include "lib/frame.glsl"
#include "lib/atmosphere.glsl"

in vec2 v_screen;
out vec4 out_colour;

void main() {
    vec3 ray = normalize(sight_ray(v_screen));
    float disc = smoothstep(0.99988, 0.99992, dot(ray, u_sun.xyz)) * smoothstep(-0.01, 0.0, ray.y);
    out_colour = vec4(sky_colour(ray) + disc * u_sunlight.rgb, 1.0);
}
