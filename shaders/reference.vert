#version 330 core
// Full-resolution tiles: one instance per tile, heights fetched by vertex number.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"

in ivec2 in_tile;  // north-west post of the tile (col, row)
uniform int u_tile_posts;

void main() {
    int row = int((float(gl_VertexID) + 0.5) / float(u_tile_posts));  // integers divide slowly
    ivec2 post = min(in_tile + ivec2(gl_VertexID - row * u_tile_posts, row), ivec2(u_grid.xy) - 1);
    emit_surface(position_of(vec2(post), post_height(post)), vec2(post), 0.0);
}
