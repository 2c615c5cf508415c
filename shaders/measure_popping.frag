#version 330 core
// Change of the signed error between consecutive frames at points visible in both: each point of this frame is looked up
// in the frame before, bilinearly where its four neighbours there show the same piece of surface.
#include "lib/frame.glsl"

uniform sampler2D u_extra0;  // positions of this frame, relative to its eye
uniform sampler2D u_extra1;  // errors of this frame (measure_error.frag)
uniform sampler2D u_extra2;  // positions of the frame before, relative to its own eye
uniform sampler2D u_extra3;  // errors of the frame before
uniform mat4 u_previous_clip_from_eye;
uniform vec3 u_eye_shift_m;  // this eye minus the eye of the frame before
out vec4 out_colour;         // x: |change| [px]; w: 1 where the point was visible before

// How far off the looked-up point may lie, in pixels: beyond, it is another piece of surface.
const float SAME_POINT_PX = 2.0;

void main() {
    out_colour = vec4(0.0);
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 here = texelFetch(u_extra0, pixel, 0);
    if (here.w < 0.5) return;
    vec3 before_m = here.xyz + u_eye_shift_m;
    vec4 clip = u_previous_clip_from_eye * vec4(before_m, 1.0);
    if (clip.w <= 0.0) return;
    vec2 at = (clip.xy / clip.w * 0.5 + 0.5) * u_viewport.xy - 0.5;
    ivec2 base = ivec2(floor(at));
    if (any(lessThan(base, ivec2(0))) || any(greaterThanEqual(base + 1, ivec2(u_viewport.xy)))) return;
    vec2 f = at - vec2(base);
    vec4 weight = vec4((1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y);
    const ivec2 corner[4] = ivec2[4](ivec2(0, 0), ivec2(1, 0), ivec2(0, 1), ivec2(1, 1));
    vec3 position_m = vec3(0.0);
    float error_px = 0.0, least = 1e30, most = 0.0;
    for (int i = 0; i < 4; ++i) {
        vec4 p = texelFetch(u_extra2, base + corner[i], 0);
        if (p.w < 0.5) return;
        position_m += weight[i] * p.xyz;
        error_px += weight[i] * texelFetch(u_extra3, base + corner[i], 0).x;
        least = min(least, dot(p.xyz, p.xyz));
        most = max(most, dot(p.xyz, p.xyz));
    }
    // A silhouette between the four: the weighted mean lies in the air.
    if (most > 1.21 * least) return;
    float miss_px = u_eye_height.w * length(position_m - before_m) / length(before_m);
    if (miss_px > SAME_POINT_PX) return;
    out_colour = vec4(abs(texelFetch(u_extra1, pixel, 0).x - error_px), 0.0, 0.0, 1.0);
}
