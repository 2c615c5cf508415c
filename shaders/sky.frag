#version 330 core
// The sky behind the terrain: a gradient by elevation from the vertex stage, and the sun's disc.
#include "lib/frame.glsl"

in vec3 v_ray;
in vec3 v_colour;
out vec4 out_colour;

void main() {
    float towards_sun = dot(v_ray, u_sun.xyz) * inversesqrt(dot(v_ray, v_ray));
    out_colour = vec4(v_colour + smoothstep(0.99988, 0.99992, towards_sun) * u_sunlight.rgb, 1.0);
}
