// The height grid and the piecewise linear surface between its posts; twin of terrain/heightfield.py.
uniform sampler2D u_heights;  // R32F, one texel per post [m]

// Height [m] of a post; past the grid its last row or column repeats.
float post_height(ivec2 post) {
    return texelFetch(u_heights, clamp(post, ivec2(0), ivec2(u_grid.xy) - 1), 0).r;
}

// Whether cell (col, row) is cut NW-SE under the alternating rule; the uniform rule cuts every cell SW-NE.
bool is_nw_se(ivec2 cell) {
    return ((cell.x + cell.y) & 1) == 0;
}

// Surface height [m] at fractional post `uv` in [0, 1]^2 of a cell with corner heights (nw, ne, sw, se).
float cell_height(vec4 corner, vec2 uv, bool nw_se) {
    float bend = corner.x + corner.w - corner.y - corner.z;
    float weight = nw_se ? min(uv.x, uv.y) : max(0.0, uv.x + uv.y - 1.0);
    return corner.x + (corner.y - corner.x) * uv.x + (corner.z - corner.x) * uv.y + bend * weight;
}

vec4 cell_corners(ivec2 cell) {
    return vec4(post_height(cell), post_height(cell + ivec2(1, 0)),
                post_height(cell + ivec2(0, 1)), post_height(cell + ivec2(1, 1)));
}

// Height [m] of the surface at a fractional post inside the grid.
float surface_height(vec2 post) {
    ivec2 cell = min(ivec2(post), ivec2(u_grid.xy) - 2);
#ifdef UNIFORM_DIAGONALS
    bool nw_se = false;
#else
    bool nw_se = is_nw_se(cell);
#endif
    return cell_height(cell_corners(cell), post - vec2(cell), nw_se);
}
