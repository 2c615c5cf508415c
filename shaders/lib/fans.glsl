// Vertex stage: the posts of a tile of triangle fans (terrain/renderers/slicing_fans.py). Include after lib/frame.glsl.
in ivec2 in_tile;             // north-west post of the tile (col, row)
uniform int u_tile_posts;     // along a side
uniform int u_stride;         // inside, every 2^u_stride-th post is a corner
uniform usampler2D u_extra2;  // stride per box of 8 x 8 cells; 0 where there are slices; large where nothing is

const int BOX_LEVEL = 3;

// The post (col, row) of this vertex. Along the border of a tile both neighbours keep the posts of the finer one.
ivec2 tile_post() {
    int row = int((float(gl_VertexID) + 0.5) / float(u_tile_posts));  // integers divide slowly
    ivec2 place = ivec2(gl_VertexID - row * u_tile_posts, row), post = in_tile + place;
    ivec2 outwards = ivec2(equal(place, ivec2(u_tile_posts - 1))) - ivec2(equal(place, ivec2(0)));
    if (outwards.x != 0 != (outwards.y != 0)) {
        // The last post of a tile is its neighbour's first.
        ivec2 box = ((post + min(outwards, 0)) >> BOX_LEVEL) + 1;
        int stride = min(int(texelFetch(u_extra2, box, 0).r), u_stride);
        post = outwards.x == 0 ? ivec2(post.x >> stride << stride, post.y) : ivec2(post.x, post.y >> stride << stride);
    }
    return min(post, ivec2(u_grid.xy) - 1);
}
