#version 330 core
// From the hit on a plane to the surface: secant steps along the sight ray between this plane and the one before, or
// where the ray entered the box.
#include "lib/frame.glsl"

// Neighbouring pixels may lie on different hills: how fast texture coordinates change is bounded.
vec2 ground_across = vec2(0.0), ground_up = vec2(0.0);
#define texture(image, place) textureGrad(image, place, ground_across, ground_up)
#include "lib/packed.glsl"
#include "lib/secant.glsl"
#include "lib/output.glsl"

uniform sampler2D u_extra1;  // hits on planes, as slicing.frag writes them
in vec2 v_screen;

#ifdef HOLES
const float ENOUGH_PX = 0.005;       // seen along the ground, a little height is far enough to come upon a hole
#else
const float ENOUGH_PX = 0.15;        // how near the surface a point must be found
#endif
const float STEEPEST = 12.0;         // a pixel covers at most this many times its width: ground seen under 5 degrees

vec2 bounded(vec2 change, float most) {
    return change * min(1.0, most * inversesqrt(max(dot(change, change), 1e-24)));
}

void main() {
    vec2 hit = texelFetch(u_extra1, ivec2(gl_FragCoord.xy), 0).rg;
    if (hit.x == 0.0) discard;
    vec3 direction = sight_ray(v_screen), sight = sight_along(direction);
    float at = hit.x, pixel_m = at * length(direction) / u_eye_height.w;
#ifndef HARD_TEST
    float before = at * 2.0 * fract(hit.y);
#ifdef FROM_ABOVE_ONLY
    if (depth_below(sight, before) >= 0.0) before = last_above(sight, at, before);
#endif
    at = surface_at(sight, at, before, max(at - before, pixel_m), ENOUGH_PX * pixel_m);
#endif
    vec3 position = direction * at;
    vec2 post = post_at(sight, at);
    vec2 inside = clamp(post, vec2(0.0), u_grid.xy - 1.0);  // borders of slices reach over the grid's edge
    position.xz += (inside - post) * u_grid.zw;
    vec2 ground = (post + 0.5) / u_grid.xy;
    float most = STEEPEST * pixel_m / min(u_grid.x * u_grid.z, u_grid.y * u_grid.w);
    ground_across = bounded(dFdx(ground), most);
    ground_up = bounded(dFdy(ground), most);
    write_surface(position, ground, floor(hit.y) + 1.0);
    gl_FragDepth = depth_of(position);
}
