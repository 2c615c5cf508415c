#version 330 core
// The overdraw view: how often each pixel was drawn, as a colour, with a legend at the lower left.
uniform sampler2D u_source;  // counts
uniform bool u_legend;
in vec2 v_screen;
out vec4 out_colour;

const int SWATCH_PX = 18;
const int STEPS = 8;  // counts 1, 2, 3, 4, 6, 8, 12, 16
const float VALUE[STEPS] = float[STEPS](1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0);
// Digits as 3 x 5 dots, three bits a row, the top row in the highest bits.
const int DIGIT[10] = int[10](0x7B6F, 0x2C97, 0x73E7, 0x73CF, 0x5BC9, 0x79CF, 0x79EF, 0x7249, 0x7BEF, 0x7BCF);

// From dark blue over magenta to pale yellow: lightness rises all the way (the order of matplotlib's plasma).
vec3 heat(float count) {
    float t = clamp(log2(max(count, 1.0)) / 4.0, 0.0, 1.0);
    vec3 low = mix(vec3(0.05, 0.03, 0.53), vec3(0.61, 0.09, 0.62), clamp(t * 3.0, 0.0, 1.0));
    vec3 high = mix(vec3(0.93, 0.47, 0.33), vec3(0.94, 0.98, 0.13), clamp(t * 3.0 - 2.0, 0.0, 1.0));
    return mix(low, high, clamp(t * 3.0 - 1.0, 0.0, 1.0));
}

bool is_dot(ivec2 pixel, int digit) {  // pixel: 0..2, 0..4, origin at the lower left of the digit
    if (any(lessThan(pixel, ivec2(0))) || pixel.x > 2 || pixel.y > 4) return false;
    return ((DIGIT[digit] >> (pixel.y * 3 + 2 - pixel.x)) & 1) == 1;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float count = texelFetch(u_source, pixel, 0).r;
    vec3 colour = count < 0.5 ? vec3(0.02) : heat(count);
    ivec2 legend = pixel - ivec2(10);
    if (u_legend && all(greaterThanEqual(legend, ivec2(-3))) && legend.x < STEPS * SWATCH_PX + 3 && legend.y < SWATCH_PX + 3) {
        colour = vec3(0.0);
        int step_number = legend.x / SWATCH_PX;
        if (all(greaterThanEqual(legend, ivec2(0))) && step_number < STEPS && legend.y < SWATCH_PX) {
            colour = heat(VALUE[step_number]);
            int value = int(VALUE[step_number]);
            ivec2 dot_place = ivec2((legend.x - step_number * SWATCH_PX) - 2, legend.y - 4) / 2;
            bool ink = value >= 10 ? is_dot(dot_place, value / 10) || is_dot(dot_place - ivec2(4, 0), value % 10)
                                   : is_dot(dot_place - ivec2(2, 0), value);
            if (ink) colour = step_number < 4 ? vec3(1.0) : vec3(0.0);
        }
    }
    out_colour = vec4(colour, 1.0);
}
