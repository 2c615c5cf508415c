#version 330 core
// The test on a slice: a fragment survives where it lies in the ground. What is kept is the slice's name;
// slicing_resolve.frag finds the surface between it and the plane before.
#include "lib/frame.glsl"
#include "lib/packed.glsl"
#include "lib/depth.glsl"
#ifdef FROM_ABOVE_ONLY
#include "lib/secant.glsl"
#include "lib/slices.glsl"
const float ENOUGH_PX = 0.005;  // triangles beside the box end on corners rounded to 1/256 px
const float GRAZING_PX = 16.0, GRAZED_PX = 0.5;  // how far back, and how deep
#ifdef HOLES
uniform sampler2D u_ground;
#endif
#endif

in vec3 v_at;  // posts from the eye in x and z, metres above it in y
flat in uint v_slice;
out uint out_slice;  // 0: none

void main() {
    if (depth_below(v_at.xz, v_at.y) < 0.0) discard;
#ifdef FROM_ABOVE_ONLY
    vec3 position = vec3(v_at.x * u_grid.z - u_eye_post.z, v_at.y, v_at.z * u_grid.w - u_eye_post.w);
    // The ray may be in the ground without having met it from above: it came through the grid's cut side, through a
    // hole, or from an eye in the ground. A mesh shows nothing there.
    float pixel = length(position) / u_eye_height.w, entry = entry_of(position, bundle_of(v_slice)).x;
    float high = depth_in_ground(position * entry);
    if (high > ENOUGH_PX * pixel) {
        float above = last_above(position, entry);
        if (above == 1.0) {
            // It may have grazed the ground just before it entered: too thin a strip for the box before to see.
            above = last_above(position * entry, 1.0 - GRAZING_PX / u_eye_height.w) * entry;
            vec2 post = u_eye_post.xy + posts_from_eye(position * above);
            bool inside = all(greaterThanEqual(post, vec2(0.0))) && all(lessThanEqual(post, u_grid.xy - 1.0));
            if (high > GRAZED_PX * pixel || above == entry || !inside) discard;
        }
        entry = above;
    }
#ifdef HOLES
    vec3 met = position * surface_at(position, entry, 0.0, 0.0);
    float level = log2(max(pixel / min(u_grid.z, u_grid.w), 1.0));
    if (textureLod(u_ground, (u_eye_post.xy + posts_from_eye(met) + 0.5) / u_grid.xy, level).a < 0.5) discard;
#endif
#endif
    out_slice = v_slice + 1u;
#ifdef LOG_DEPTH
    gl_FragDepth = depth_at(1.0 / gl_FragCoord.w);
#endif
}
