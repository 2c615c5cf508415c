#version 330 core
// Slices drawn straight into the picture: antialiased (section 7), for counting, and as lines.
#include "lib/frame.glsl"
#include "lib/packed.glsl"
#include "lib/secant.glsl"
#include "lib/bundle.glsl"
#include "lib/output.glsl"

void main() {
    vec3 direction = sight_ray(gl_FragCoord.xy * u_viewport.zw), sight = sight_along(direction);
    float at = 1.0 / gl_FragCoord.w;
#ifdef ANTIALIASED
    // Opacity falls from one to zero over one pixel above the surface; slices come back to front.
    float pixel_m = at * length(direction) / u_eye_height.w;
    float deep = depth_below(sight, at);
    float opacity = clamp(1.0 + deep / pixel_m, 0.0, 1.0);
    if (opacity == 0.0) discard;
#ifndef HARD_TEST
    Planes planes = planes_along(sight);
    if (deep > 0.0) at = surface_at(sight, at, planes.before, planes.step, 0.25 * pixel_m);
#endif
#endif
    vec3 position = direction * at;
    write_surface(position, (post_at(sight, at) + 0.5) / u_grid.xy, 0.0);
#ifdef ANTIALIASED
    out_colour.a = opacity;
#endif
#ifdef LOG_DEPTH
    gl_FragDepth = depth_of(position);
#endif
}
