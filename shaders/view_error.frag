#version 330 core
// The error heat map: what measure_error.frag found, as colour. White is no error; blue lies below the reference surface,
// red above, full colour at the tolerance; beyond the tolerance it darkens.
#include "lib/frame.glsl"

uniform sampler2D u_extra1;  // x: signed error [px]; w: 1 where covered
uniform float u_tolerance_px;
in vec2 v_screen;
out vec4 out_colour;

void main() {
    vec4 error = texelFetch(u_extra1, ivec2(gl_FragCoord.xy), 0);
    float share = abs(error.x) / u_tolerance_px;
    vec3 hue = error.x > 0.0 ? vec3(0.84, 0.37, 0.0) : vec3(0.0, 0.45, 0.70);
    vec3 colour = mix(vec3(0.97), hue, min(share, 1.0)) * (1.0 - 0.75 * clamp(share - 1.0, 0.0, 1.0));
    out_colour = vec4(error.w > 0.5 ? colour : vec3(0.09, 0.10, 0.12), 1.0);
}
