#version 330 core
// The sun's disc: light added to the sky.
#include "lib/frame.glsl"

in vec3 v_ray;
out vec4 out_colour;

void main() {
    float towards_sun = dot(v_ray, u_sun.xyz) * inversesqrt(dot(v_ray, v_ray));
    out_colour = vec4(smoothstep(0.99988, 0.99992, towards_sun) * u_sunlight.rgb, 0.0);
}
