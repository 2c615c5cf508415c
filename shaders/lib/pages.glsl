// Texture trees: an atlas of tiles, and a page table per tree that says where to look (terrain/textures/atlas.py).
// Any number of trees takes two texture units.
uniform sampler2DArray u_pages;  // per tile of level 0: xy + z * pixel is the texel in layer w of the atlas; w < 0: nothing
uniform sampler2DArray u_atlas;  // RGBA, premultiplied

const int TREE_LIMIT = 16;       // as in terrain/textures/trees.py
const float TILE_PX = 254.0;     // as in terrain/textures/tree.py
const float LAYER_PX = 1024.0;   // as in terrain/textures/atlas.py

layout(std140) uniform Trees {
    vec4 u_trees[3 * TREE_LIMIT];  // two rows of the affine map from ground coordinates to pixels; the last pixel
};

// A tree's colour at a ground coordinate, premultiplied by its alpha; all 0 outside the image and before its first tile.
vec4 sample_tree(int tree, vec2 ground) {
    vec3 place = vec3(ground, 1.0);
    vec2 px = vec2(dot(u_trees[3 * tree].xyz, place), dot(u_trees[3 * tree + 1].xyz, place));
    vec2 inside = clamp(px, vec2(0.0), u_trees[3 * tree + 2].xy);
    // Rounded to the neighbouring cell, the page is still right: its tile has a border.
    vec4 page = texelFetch(u_pages, ivec3(inside * (1.0 / TILE_PX), tree), 0);
    // To the 256th of a texel, as hardware filters: then no bit depends on where in the atlas the tile is.
    vec2 at = page.xy + round(256.0 * page.z * inside) / 256.0;
    vec4 colour = textureLod(u_atlas, vec3(at / LAYER_PX, page.w), 0.0);
    return inside == px && page.w >= 0.0 ? colour : vec4(0.0);
}
