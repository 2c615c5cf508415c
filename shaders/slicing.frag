#version 330 core
// The test on a slice, and on the planes between it and the slice before: a fragment survives where one of them lies in
// the ground. What is kept is where the ray meets the first such plane; slicing_resolve.frag finds the surface between
// it and the plane before.
#include "lib/frame.glsl"
#include "lib/packed.glsl"
#include "lib/depth.glsl"
#include "lib/bundle.glsl"
#ifdef FROM_ABOVE_ONLY
#include "lib/secant.glsl"
const float ENOUGH_PX = 0.005;  // triangles beside the box end on corners rounded to 1/256 px
const float GRAZING_PX = 16.0, GRAZED_PX = 0.5;  // how far back, and how deep
#ifdef HOLES
uniform sampler2D u_ground;
#endif
#endif

// Slices reach so far over the ground: coarser fans beside them may stand above it, and no ray must slip below those.
uniform float u_raise_px;
const int MOST_TESTS = 16;  // a slice stands for fewer planes

out vec2 out_hit;  // x: view depth [m] of the plane, 0: none; y: the axis, and half the share of it at the plane before

void main() {
    vec3 direction = sight_ray(gl_FragCoord.xy * u_viewport.zw), sight = sight_along(direction);
    Planes planes = planes_along(sight);
    float at = planes.first, before = planes.before, last = planes.end - SAME * planes.step, depth;
    for (int i = 0; i < MOST_TESTS; ++i) {
        if (at > last) at = planes.end;
        depth = depth_below(sight, at);
        bool is_raised = at == planes.end;
#ifdef FROM_ABOVE_ONLY
        is_raised = is_raised && depth_below(sight, before) < depth;  // not where the ray comes out of the ground
#endif
        if (is_raised) depth += u_raise_px * at / u_eye_height.w;
        if (depth >= 0.0 || at == planes.end) break;
        before = at;
        at += planes.step;
    }
    if (depth < 0.0) discard;
#ifdef FROM_ABOVE_ONLY
    // The ray may be in the ground without having met it from above: it came through the grid's cut side, through a
    // hole, or from an eye in the ground. A mesh shows nothing there.
    float pixel = at * length(direction) / u_eye_height.w;
    float high = depth_below(sight, before);
    if (high > ENOUGH_PX * pixel) {
        float above = last_above(sight, at, before);
        if (above == at) {
            // It may have grazed the ground just before it entered: too thin a strip for the box before to see.
            above = last_above(sight, before, before * (1.0 - GRAZING_PX / u_eye_height.w));
            vec2 post = post_at(sight, above);
            bool inside = all(greaterThanEqual(post, vec2(0.0))) && all(lessThanEqual(post, u_grid.xy - 1.0));
            if (high > GRAZED_PX * pixel || above == before || !inside) discard;
        }
        before = above;
    }
#ifdef HOLES
    vec2 met = post_at(sight, surface_at(sight, at, before, 0.0, 0.0));
    float level = log2(max(pixel / min(u_grid.z, u_grid.w), 1.0));
    if (textureLod(u_ground, (met + 0.5) / u_grid.xy, level).a < 0.5) discard;
#endif
#endif
    out_hit = vec2(at, v_planes.w + 0.5 * min(before / at, 0.999999));
#ifdef LOG_DEPTH
    gl_FragDepth = depth_at(planes.end);
#endif
}
