#version 330 core
// Polygon boxes of the debug picture (figure 4): fans with dark centres.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/fans.glsl"

out vec4 v_paint;  // rgb: light; a: level whose colour it falls on, 0 for polygons

void main() {
    ivec2 post = tile_post();
    v_paint = vec4(vec3((post.x & post.y & 1 << u_stride) != 0 ? 0.0 : 1.0), 0.0);
    gl_Position = u_clip_from_eye * vec4(position_of(vec2(post), post_height(post)), 1.0);
}
