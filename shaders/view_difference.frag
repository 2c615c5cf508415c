#version 330 core
// The difference of two pictures, channel by channel, GAIN times: black where they are the same.
uniform sampler2D u_extra0;
uniform sampler2D u_extra1;
in vec2 v_screen;
out vec4 out_colour;

const float GAIN = 4.0;  // a difference of 64 steps of 255 is full brightness: what one sees at a glance, one sees here

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 difference = texelFetch(u_extra0, pixel, 0).rgb - texelFetch(u_extra1, pixel, 0).rgb;
    out_colour = vec4(min(abs(difference) * GAIN, 1.0), 1.0);
}
