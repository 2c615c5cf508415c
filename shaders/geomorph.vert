#version 330 core
// Larsen and Christensen, "Real-time terrain rendering using smooth hardware optimized level of detail" (2003):
// one instance per tile; every post is morphed towards the next coarser level (table 3), and on an edge by the level
// both of its sides share (table 4), so that the surface is watertight in every intermediate state.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"

in ivec3 in_tile;     // north-west post (col, row); drawn level L
in float in_lam;      // lambda of the interior
in vec4 in_edge_lam;  // lambda of the north, south, west and east edge
uniform int u_cells;  // cells per side as drawn: 2^(t - L)

uniform sampler2D u_morph;  // RG32F: height of each post, and the height it is morphed to, at the one level that can

void main() {
    // Division by a float is exact for the few posts of a tile, and integers divide slowly.
    int row = int((float(gl_VertexID) + 0.5) / float(u_cells + 1));
    ivec2 ij = ivec2(gl_VertexID - row * (u_cells + 1), row);
    int level = in_tile.z;
    ivec2 cell = in_tile.xy >> level;
    // A tile of a single cell may be one that is cut SW-NE: turn the mesh, whose first cell is cut NW-SE.
    if (u_cells == 1 && !is_nw_se(cell)) ij = ivec2(1 - ij.y, ij.x);
    ivec2 post = in_tile.xy + (ij << level);

    float v = clamp(in_lam - float(level), 0.0, 1.0);
    bool north = ij.y == 0, south = ij.y == u_cells, west = ij.x == 0, east = ij.x == u_cells;
    if (north || south || west || east) {
        // Corners are posts of every level this tile can have: whichever edge they are counted to, they stay.
        float lam = north ? in_edge_lam.x : south ? in_edge_lam.y : west ? in_edge_lam.z : in_edge_lam.w;
        level = int(lam);
        v = lam - float(level);
        // Posts the edge does not have at its level fall together with the one before.
        if (north || south) post.x = (post.x >> level) << level;
        else post.y = (post.y >> level) << level;
        if ((north || south) && (west || east)) v = 0.0;
    }
    vec2 height_m = texelFetch(u_morph, post, 0).rg;
    ivec2 odd = (post >> level) & 1;
    float share = (odd.x | odd.y) == 0 ? 0.0 : v;  // posts of the next level stay
    // Not mix: posts that stay must keep their bits for every v.
    emit_surface(position_of(vec2(post), height_m.x + share * (height_m.y - height_m.x)), vec2(post), in_lam);
}
