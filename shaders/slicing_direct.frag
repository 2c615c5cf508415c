#version 330 core
// Slices drawn straight into the picture: antialiased (section 7), for counting, and as lines.
#include "lib/frame.glsl"
#include "lib/packed.glsl"
#include "lib/secant.glsl"
#include "lib/slices.glsl"
#include "lib/output.glsl"

in vec3 v_at;  // posts from the eye in x and z, metres above it in y
flat in uint v_slice;

void main() {
    vec3 position = vec3(v_at.x * u_grid.z - u_eye_post.z, v_at.y, v_at.z * u_grid.w - u_eye_post.w);
#ifdef ANTIALIASED
    // Opacity falls from one to zero over one pixel above the surface; slices come back to front.
    float pixel_m = length(position) / u_eye_height.w;
    float deep = depth_in_ground(position);
    float opacity = clamp(1.0 + deep / pixel_m, 0.0, 1.0);
    if (opacity == 0.0) discard;
#ifndef HARD_TEST
    vec2 entry = entry_of(position, bundle_of(v_slice));
    if (deep > 0.0) position *= surface_at(position, entry.x, entry.y, 0.25 * pixel_m);
#endif
    vec2 post = u_eye_post.xy + posts_from_eye(position);
#else
    vec2 post = u_eye_post.xy + posts_from_eye(position);
#endif
    write_surface(position, (post + 0.5) / u_grid.xy, 0.0);
#ifdef ANTIALIASED
    out_colour.a = opacity;
#endif
#ifdef LOG_DEPTH
    gl_FragDepth = depth_of(position);
#endif
}
