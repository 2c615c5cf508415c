// Texture trees: an atlas of tiles, and a page table per tree that says where to look (terrain/textures/atlas.py).
// Any number of trees takes two texture units. Include after lib/frame.glsl.
uniform usampler2DArray u_pages;  // per tile of level 0: column and row of a slot, its layer, the level of the tile there
uniform sampler2DArray u_atlas;   // RGBA, premultiplied

const int TREE_LIMIT = 16;        // as in terrain/textures/trees.py
const float TILE_PX = 254.0;      // as in terrain/textures/tree.py
const float BORDER_PX = 1.0;
const float SLOT_PX = TILE_PX + 2.0 * BORDER_PX;
const float LAYER_PX = 4.0 * SLOT_PX;
const uint NO_PAGE = 255u;

layout(std140) uniform Trees {
    vec4 u_trees[3 * TREE_LIMIT];  // two rows of the affine map from ground coordinates to pixels; size [px], cells
};

// A tree's colour at a ground coordinate, premultiplied by its alpha; all 0 outside the image and before its first tile.
vec4 sample_tree(int tree, vec2 ground) {
    vec3 place = vec3(ground, 1.0);
    vec4 size = u_trees[3 * tree + 2];
    vec2 px = vec2(dot(u_trees[3 * tree].xyz, place), dot(u_trees[3 * tree + 1].xyz, place));
    vec2 inside = clamp(px, vec2(0.0), size.xy);
    ivec2 cell = ivec2(min(floor(inside / TILE_PX), size.zw - 1.0));
    uvec4 page = texelFetch(u_pages, ivec3(cell, tree), 0);
    int level = int(page.w);
    // A cell's number may be one off where it begins: the tile's border holds what is then read.
    vec2 texel = inside * exp2(-float(level)) - vec2(cell >> level) * TILE_PX;
    vec2 at = (vec2(page.xy) * SLOT_PX + BORDER_PX + texel) / LAYER_PX;
    vec4 colour = textureLod(u_atlas, vec3(at, float(page.z)), 0.0);
    return inside == px && page.w != NO_PAGE ? colour : vec4(0.0);
}
