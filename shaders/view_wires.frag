#version 330 core
// The wireframe view: darkens the picture where a line was drawn. Where lines are so dense that they would cover all, far
// away, they fade, and the shape of the ground stays visible below them.
uniform sampler2D u_source;  // rgb: the picture; a: 1 where a line was drawn; with mipmaps
in vec2 v_screen;
out vec4 out_colour;

const vec3 LINE = vec3(0.03, 0.03, 0.05);
const float NEIGHBOURHOOD = 3.0;           // mipmap level of 8 x 8 pixels, over which density is counted
const vec2 OPACITY = vec2(0.60, 0.13);     // of a single line, and where all is lines
const vec2 CROWDED = vec2(0.20, 0.80);     // share of pixels covered by lines, where fading begins and ends

void main() {
    vec4 picture = texelFetch(u_source, ivec2(gl_FragCoord.xy), 0);
    float density = textureLod(u_source, v_screen, NEIGHBOURHOOD).a;
    float opacity = mix(OPACITY.x, OPACITY.y, smoothstep(CROWDED.x, CROWDED.y, density));
    out_colour = vec4(mix(picture.rgb, LINE, opacity * picture.a), 1.0);
}
