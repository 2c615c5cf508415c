#version 330 core
// Polygon boxes of the debug picture (figure 4): fans of 2 x 2 cells with dark centres.
#include "lib/frame.glsl"
#include "lib/surface.glsl"

in ivec2 in_tile;  // north-west post of the tile (col, row)
uniform int u_tile_posts;
out vec4 v_paint;  // rgb: light; a: level whose colour it falls on, 0 for polygons

void main() {
    ivec2 post = min(in_tile + ivec2(gl_VertexID % u_tile_posts, gl_VertexID / u_tile_posts), ivec2(u_grid.xy) - 1);
    v_paint = vec4(vec3((post.x & post.y & 1) == 1 ? 0.0 : 1.0), 0.0);
    gl_Position = u_clip_from_eye * vec4(position_of(vec2(post), post_height(post)), 1.0);
}
