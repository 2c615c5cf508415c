#version 330 core
// The sky behind the terrain: a gradient by elevation and the sun's disc.
#include "lib/frame.glsl"

in vec2 v_screen;
out vec4 out_colour;

void main() {
    vec3 ray = normalize(u_ray[0].xyz + v_screen.x * u_ray[1].xyz + v_screen.y * u_ray[2].xyz);
    vec3 colour = mix(u_horizon.rgb, u_zenith.rgb, pow(clamp(ray.y, 0.0, 1.0), 0.55));
    colour = mix(colour, u_fog_colour.rgb, clamp(-ray.y * 8.0, 0.0, 1.0) * 0.5);
    float towards_sun = max(dot(ray, u_sun.xyz), 0.0) * u_sun.w;
    colour += vec3(1.0, 0.9, 0.7) * (smoothstep(0.9994, 0.9998, towards_sun) + 0.12 * pow(towards_sun, 64.0));
    out_colour = vec4(colour, 1.0);
}
