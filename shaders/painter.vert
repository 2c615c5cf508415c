#version 330 core
// Alonso and Joan-Arinyo, "Back-to-front ordering of triangles in digital terrain models over regular grids": the order
// is computed here from the vertex number alone (their section 8 wishes for it); nothing is uploaded when the eye moves.
// Twin of terrain/algorithms/painter.py (strips, cells) and painter_levels.py (blocks).
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/emit.glsl"

// The foot point O' of the eye as floors of: col, row, col + row, col - row, 2 col + row, col + 2 row.
uniform int u_foot[6];
uniform ivec3 u_tiles;        // rows and columns of tiles; log2 of the posts along a tile
uniform ivec4 u_run;          // rank of the first tile; level; pattern; stitched edges (INDEXED: tile number; sector)
uniform usampler2D u_extra0;  // orders of stitched blocks: (sides, edges), eight triangles of three bits
uniform int u_colours;        // what OUTPUT_LEVELS shows: 0 sectors, 1 levels

// Patterns below CELLS are the strips of a tile inside one sector.
const int NE1 = 0, NE2 = 1, NW = 2, SW1 = 3, SW2 = 4, SE = 5, CELLS = 6, BLOCKS = 7, INDEXED = 8;
const int NORTH = 1, EAST = 2, SOUTH = 4, WEST = 8;

// a / b for 0 <= a < 2^30, 0 < b: exact, and several times faster than integer division where that is no instruction.
int quotient(int a, int b) {
    int q = int(float(a) / float(b));
    q -= int(q * b > a);
    return q + int((q + 1) * b <= a);
}

// Line of a rank: `before` lines from the far end up to O', then the others from the other end.
int line_of(int rank, int count, int before) {
    before = clamp(before, 0, count);
    return rank < before ? rank : before + count - 1 - rank;
}

// The foot in cells of 2^level posts, counted from the post (col, row).
void foot_from(ivec2 origin, int level, out ivec2 westnorth, out ivec4 slanted) {
    westnorth = (ivec2(u_foot[0], u_foot[1]) - origin) >> level;
    slanted = (ivec4(u_foot[2], u_foot[3], u_foot[4], u_foot[5])
               - ivec4(origin.x + origin.y, origin.x - origin.y, 2 * origin.x + origin.y, origin.x + 2 * origin.y)) >> level;
}

// Where the post (col, row) of a tile with `cells` cells a side is drawn when `edges` meet a coarser neighbour.
ivec2 stitched(ivec2 post, int cells, int edges) {
    bool north = (edges & NORTH) != 0, east = (edges & EAST) != 0, south = (edges & SOUTH) != 0, west = (edges & WEST) != 0;
    ivec2 p = post;
    if ((post.y & 1) == 1) {
        if (post.x == 0 && west) p.y += post.y == 1 && north ? -1 : 1;
        else if (post.x == cells && east) p.y += post.y == cells - 1 && south ? 1 : -1;
    }
    if ((post.x & 1) == 1) {
        if (post.y == 0 && north) p.x += post.x == 1 && west ? -1 : 1;
        else if (post.y == cells && south) p.x += post.x == cells - 1 && east ? 1 : -1;
    }
    return p;
}

// Corner k of the north-west (half 0) or south-east (half 1) triangle of a cell, counter-clockwise from above.
ivec2 triangle_corner(int triangle, int k) {
    return triangle == 0 ? ivec2(k >> 1, k & 1) : ivec2(k == 1 ? 0 : 1, k == 0 ? 0 : 1);
}

#ifdef OUTPUT_LEVELS
// Sector of a cell: NE1, NE2, NW, SW1, SW2, SE.
float sector_of(ivec2 cell, ivec2 westnorth, int diagonal) {
    bool is_west = cell.x < westnorth.x, is_north = cell.y < westnorth.y, is_above = cell.x + cell.y < diagonal;
    return float(is_north ? (is_west ? NW : is_above ? NE2 : NE1) : (!is_west ? SE : is_above ? SW1 : SW2));
}
#endif

void main() {
    int level = u_run.y, pattern = u_run.z, tile_cells = 1 << (u_tiles.z - level);
    int tile, local = gl_VertexID;
    ivec2 tile_at, post, cell;
    if (pattern == INDEXED) {
        tile = quotient(u_run.x, u_tiles.y);
        tile_at = ivec2(u_run.x - tile * u_tiles.y, tile);
    } else {
        // Counting lines from the second vertex on turns rows counter-clockwise; columns are so by themselves.
        if (pattern < CELLS && pattern != NE2 && pattern != SW2) local = max(local - 1, 0);
        int line = 2 * tile_cells + 4;  // vertices of a strip, its first and last post twice
        int count = pattern < CELLS ? tile_cells * line : 6 * tile_cells * tile_cells;
        tile = quotient(local, count);
        local -= tile * count;
        tile += u_run.x;
        int row = quotient(tile, u_tiles.y);
        tile_at = ivec2(line_of(tile - row * u_tiles.y, u_tiles.y, u_foot[0] >> u_tiles.z),
                        line_of(row, u_tiles.x, u_foot[1] >> u_tiles.z));
    }
    ivec2 origin = tile_at << u_tiles.z;
    ivec2 westnorth;
    ivec4 slanted;
    foot_from(origin, level, westnorth, slanted);

    if (pattern == INDEXED) {
        int row = quotient(gl_VertexID, tile_cells + 1);
        post = ivec2(gl_VertexID - row * (tile_cells + 1), row);
    } else if (pattern < CELLS) {
        int line = 2 * tile_cells + 4, number = quotient(local, line);
        int k = clamp(local - number * line - 1, 0, line - 3);
        int along = k >> 1, side = k & 1;
        // Figures 5 and 7, the far lines first; SW1, SW2 and SE are NE1, NE2 and NW turned by half a turn.
        if (pattern == NW || pattern == SE) post = ivec2(along, number + side);
        else if (pattern == NE1 || pattern == SW1) post = ivec2(tile_cells - along, number + 1 - side);
        else post = ivec2(tile_cells - 1 - number + side, along);
        if (pattern >= SW1) post = tile_cells - post;
    } else if (pattern == CELLS) {
        int number = quotient(local, 6), k = local - 6 * number, shift = u_tiles.z - level;
        cell = ivec2(line_of(number & (tile_cells - 1), tile_cells, westnorth.x),
                     line_of(number >> shift, tile_cells, westnorth.y));
        int far = slanted.x > cell.x + cell.y ? 0 : 1;  // O' beyond the diagonal: the north-west triangle first
        post = cell + triangle_corner(k < 3 ? far : 1 - far, k < 3 ? k : k - 3);
    } else {
        int number = quotient(local, 24), k = local - 24 * number, shift = u_tiles.z - level - 1, half_cells = tile_cells >> 1;
        ivec2 block = 2 * ivec2(line_of(number & (half_cells - 1), half_cells, westnorth.x >> 1),
                                line_of(number >> shift, half_cells, westnorth.y >> 1));
        ivec2 w = westnorth - block;
        ivec4 s = slanted - ivec4(block.x + block.y, block.x - block.y, 2 * block.x + block.y, block.x + 2 * block.y);
        int sides = int(w.x >= 1) | int(w.y >= 1) << 1 | int(s.x >= 1) << 2 | int(s.x >= 2) << 3 | int(s.x >= 3) << 4
                  | int(s.z >= 2) << 5 | int(s.z >= 4) << 6 | int(s.w >= 2) << 7 | int(s.w >= 4) << 8 | int(s.y >= 0) << 9;
        int touching = (block.y == 0 ? NORTH : 0) | (block.x == tile_cells - 2 ? EAST : 0)
                     | (block.y == tile_cells - 2 ? SOUTH : 0) | (block.x == 0 ? WEST : 0);
        uint order = texelFetch(u_extra0, ivec2(sides, u_run.w & touching), 0).r;
        int nth = quotient(k, 3), triangle = int(order >> uint(3 * nth)) & 7;
        cell = block + ivec2((triangle >> 1) & 1, triangle >> 2);
        post = stitched(cell + triangle_corner(triangle & 1, k - 3 * nth), tile_cells, u_run.w);
    }

    ivec2 at = min(origin + (post << level), ivec2(u_grid.xy) - 1);
    float shown = float(level);
#ifdef OUTPUT_LEVELS
    if (u_colours == 0) {
        shown = float(pattern == INDEXED ? u_run.w : pattern);
        if (pattern == CELLS || pattern == BLOCKS) shown = sector_of(cell, westnorth, slanted.x);
    }
#endif
    emit_surface(position_of(vec2(at), post_height(at)), vec2(at), shown);
}
