// The surface by one fetch per point. u_packed holds for every cell what its height is made of: with u eastwards and v
// southwards, h = x + y u + z v + w min(u, v), where u runs westwards in cells that are cut SW-NE
// (terrain/renderers/slicing_bundles.py: pack_cells). Include after lib/frame.glsl.
uniform sampler2D u_packed;   // RGBA32F, one texel per cell
uniform vec4 u_posts_from_m;  // xy: posts per metre; zw: how far the eye is past the post north-west of it [posts]
uniform vec2 u_per_cell;      // 1 / cells; divisions are dear on software

// A sight ray by view depth t [m] in the ground's own measures: x and z in posts, y in metres.
vec3 sight_along(vec3 direction) {
    return vec3(direction.xz * u_posts_from_m.xy, direction.y).xzy;
}

// Fractional post (col, row) where the ray is at t.
vec2 post_at(vec3 sight, float t) {
    return u_eye_post.xy + (u_posts_from_m.zw + sight.xz * t);
}

// How deep [m] the ray is in the ground at t; past the grid's edges their heights go on.
float depth_below(vec3 sight, float t) {
    vec2 posts = u_posts_from_m.zw + sight.xz * t;  // small numbers, so that float32 resolves a cell near the eye
    vec2 cell = clamp(u_eye_post.xy + floor(posts), vec2(0.0), u_grid.xy - 2.0);
    vec2 uv = clamp(posts + (u_eye_post.xy - cell), 0.0, 1.0);
    float is_sw_ne = 2.0 * fract(0.5 * (cell.x + cell.y));
    uv.x = abs(is_sw_ne - uv.x);
    vec4 ground = textureLod(u_packed, (cell + 0.5) * u_per_cell, 0.0);  // on software cheaper than texelFetch
    float height_m = ground.x + ground.y * uv.x + ground.z * uv.y + ground.w * min(uv.x, uv.y);
    return height_from_eye(height_m) - sight.y * t;
}
