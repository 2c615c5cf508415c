#version 330 core
// From the hit on a slice to the surface: secant steps along the sight ray between this plane and the one before, or
// where the ray entered the box.
#include "lib/frame.glsl"

// Neighbouring pixels may lie on different hills: how fast texture coordinates change is bounded.
vec2 ground_across = vec2(0.0), ground_up = vec2(0.0);
#define texture(image, place) textureGrad(image, place, ground_across, ground_up)
#include "lib/packed.glsl"
#include "lib/secant.glsl"
#include "lib/slices.glsl"
#include "lib/output.glsl"

uniform usampler2D u_extra1;  // names of the slices hit
in vec2 v_screen;

#ifdef HOLES
const float ENOUGH_PX = 0.005;       // seen along the ground, a little height is far enough to come upon a hole
#else
const float ENOUGH_PX = 0.15;        // how near the surface a point must be found
#endif
const float STEEPEST = 12.0;         // a pixel covers at most this many times its width: ground seen under 5 degrees

vec2 bounded(vec2 change, float most) {
    return change * min(1.0, most / max(length(change), 1e-12));
}

void main() {
    uint name = texelFetch(u_extra1, ivec2(gl_FragCoord.xy), 0).r;
    if (name == 0u) discard;
    Bundle bundle = bundle_of(name - 1u);
    int axis;
    float plane;
    plane_of(bundle, name - 1u, axis, plane);
    vec3 ray = u_ray[0].xyz + v_screen.x * u_ray[1].xyz + v_screen.y * u_ray[2].xyz;
    vec3 position = ray * (plane / ray[axis]);
    float pixel_m = length(position) / u_eye_height.w;
#ifndef HARD_TEST
    vec2 entry = entry_of(position, bundle);
#ifdef FROM_ABOVE_ONLY
    if (depth_in_ground(position * entry.x) >= 0.0) entry.x = last_above(position, entry.x);
#endif
    position *= surface_at(position, entry.x, entry.y, ENOUGH_PX * pixel_m);
#endif
    vec2 post = u_eye_post.xy + posts_from_eye(position);
    vec2 inside = clamp(post, vec2(0.0), u_grid.xy - 1.0);  // borders of slices reach over the grid's edge
    position.xz += (inside - post) * u_grid.zw;
    vec2 ground = (post + 0.5) / u_grid.xy;
    float most = STEEPEST * pixel_m / min(u_grid.x * u_grid.z, u_grid.y * u_grid.w);
    ground_across = bounded(dFdx(ground), most);
    ground_up = bounded(dFdy(ground), most);
    write_surface(position, ground, float(bundle.axis + 1));
    gl_FragDepth = depth_of(position);
}
