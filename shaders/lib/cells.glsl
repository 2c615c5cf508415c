// Where a ray falls through the surface of one cell. Include after lib/bars.glsl.
//
// Between t0 and t1 the gap between ray and surface is cut where it may turn (the diagonal of a triangulated cell, the
// vertex of a bilinear cell's parabola, eighths of a bicubic cell). In each piece the ray falls through the surface where
// it was above before and is not above at the end: that leaves no room for rounding to let it slip through.
uniform sampler2D u_packed;  // RGBA32F: corner heights (nw, ne, sw, se) of every cell
uniform sampler2D u_posts;   // R32F: heights of posts

const float NO_HIT = -1.0;
// From below, a ray this share of its length above the surface has come up: over a step between levels of detail. Less is
// rounding where it has just passed through ground without data.
const float RISEN = 1e-5;

float fall(float t0, float gap0, float t1, float gap1) {
    return gap0 > 0.0 ? mix(t0, t1, gap0 / (gap0 - gap1)) : t0;
}

// Corner heights relative to the eye.
vec4 corners_from_eye(ivec2 cell) {
#ifdef PACKED
    vec4 corners = texelFetch(u_packed, cell, 0);
#else
    vec4 corners = vec4(texelFetch(u_posts, cell, 0).r, texelFetch(u_posts, cell + ivec2(1, 0), 0).r,
                        texelFetch(u_posts, cell + ivec2(0, 1), 0).r, texelFetch(u_posts, cell + ivec2(1, 1), 0).r);
#endif
    return (corners - u_eye_map.z) - u_eye_map.w;
}

#if defined(BICUBIC)
const int PIECES = 8;
const int REFINEMENTS = 6;  // regula falsi (Illinois): six give all digits a float has over an eighth of a cell

// Catmull-Rom weights of the four posts around s.
vec4 spline(float s) {
    return vec4(0.5 * s * (-1.0 + s * (2.0 - s)), 1.0 + 0.5 * s * s * (-5.0 + 3.0 * s),
                0.5 * s * (1.0 + s * (4.0 - 3.0 * s)), 0.5 * s * s * (s - 1.0));
}

float gap_at(Bars bars, mat4 posts, vec2 corner, float t) {
    vec2 uv = clamp(bars.direction.xy * t - corner, 0.0, 1.0);
    return bars.direction.z * t - dot(posts * spline(uv.x), spline(uv.y));
}

mat4 posts_around(ivec2 cell) {
    mat4 posts;  // columns west to east, rows north to south
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            posts[i][j] = texelFetch(u_posts, clamp(cell + ivec2(i - 1, j - 1), ivec2(0), u_cells), 0).r;
    return posts;
}

float cross_cell(Bars bars, ivec2 cell, float t0, float t1, inout bool is_above, inout vec2 slope) {
    mat4 posts = posts_around(cell);
    for (int i = 0; i < 4; ++i) posts[i] = (posts[i] - u_eye_map.z) - u_eye_map.w;
    vec2 corner = corner_from_eye(cell);
    float hit = NO_HIT, from = t0, gap_from = gap_at(bars, posts, corner, t0);
    is_above = is_above || gap_from > RISEN * t0;
    for (int piece = 1; piece <= PIECES; ++piece) {
        float to = mix(t0, t1, float(piece) / float(PIECES)), gap_to = gap_at(bars, posts, corner, to);
        if (is_above && gap_to <= 0.0) {
            float above = from, gap_above = gap_from, under = to, gap_under = gap_to;
            hit = fall(above, gap_above, under, gap_under);
            for (int i = 0, kept = 0; i < REFINEMENTS && gap_above > 0.0 && gap_under < 0.0; ++i) {
                float gap = gap_at(bars, posts, corner, hit);
                if (gap > 0.0) {
                    above = hit;
                    gap_above = gap;
                    if (kept == 1) gap_under *= 0.5;
                    kept = 1;
                } else {
                    under = hit;
                    gap_under = gap;
                    if (kept == -1) gap_above *= 0.5;
                    kept = -1;
                }
                hit = gap_under < 0.0 ? fall(above, gap_above, under, gap_under) : under;
            }
            vec2 uv = bars.direction.xy * hit - corner;
            slope = vec2(mix(posts[2][1] - posts[1][1], posts[2][2] - posts[1][2], uv.y),
                         mix(posts[1][2] - posts[1][1], posts[2][2] - posts[2][1], uv.x));
            break;
        }
        is_above = gap_to > 0.0;
        from = to;
        gap_from = gap_to;
    }
    return hit;
}

#elif defined(BILINEAR)
float cross_cell(Bars bars, ivec2 cell, float t0, float t1, inout bool is_above, inout vec2 slope) {
    vec4 h = corners_from_eye(cell);
    vec2 corner = corner_from_eye(cell);
    vec2 uv0 = bars.direction.xy * t0 - corner, uv1 = bars.direction.xy * t1 - corner, change = uv1 - uv0;
    float bend = h.x + h.w - h.y - h.z;
    // The gap is c + b s + a s^2 over s = 0..1 between t0 and t1.
    float a = -bend * change.x * change.y;
    float c = bars.direction.z * t0 - (h.x + (h.y - h.x) * uv0.x + (h.z - h.x) * uv0.y + bend * uv0.x * uv0.y);
    float end = bars.direction.z * t1 - (h.x + (h.y - h.x) * uv1.x + (h.z - h.x) * uv1.y + bend * uv1.x * uv1.y);
    float b = end - c - a;
    is_above = is_above || c > RISEN * t0;
    float turn = abs(b) < 2.0 * abs(a) ? clamp(-0.5 * b / a, 0.0, 1.0) : 1.0;
    float gap_turn = c + turn * (b + turn * a);
    // Of the two roots the one where the gap falls, in the form that does not cancel.
    float root = sqrt(max(b * b - 4.0 * a * c, 0.0));
    float s = b <= 0.0 ? 2.0 * c / max(root - b, 1e-30) : -0.5 * (b + root) / a;
    bool first = is_above && gap_turn <= 0.0, second = !first && (turn < 1.0 ? gap_turn > 0.0 : false) && end <= 0.0;
    is_above = end > 0.0;
    if (first || second) {
        vec2 uv = mix(uv0, uv1, clamp(s, 0.0, 1.0));
        slope = vec2(h.y - h.x, h.z - h.x) + bend * uv.yx;
    }
    if (first) return mix(t0, t1, c > 0.0 ? clamp(s, 0.0, turn) : 0.0);
    return second ? mix(t0, t1, clamp(s, turn, 1.0)) : NO_HIT;
}

#else
float cross_cell(Bars bars, ivec2 cell, float t0, float t1, inout bool is_above, inout vec2 slope) {
    vec4 h = corners_from_eye(cell);
    vec2 corner = corner_from_eye(cell);
    vec2 uv0 = bars.direction.xy * t0 - corner, uv1 = bars.direction.xy * t1 - corner;
    bool mirrored = ((cell.x + cell.y) & 1) == 1;
    if (mirrored) {  // seen in a mirror a SW-NE diagonal is a NW-SE one, u = v
        h = h.yxwz;
        uv0.x = 1.0 - uv0.x;
        uv1.x = 1.0 - uv1.x;
    }
    vec3 plane = vec3(h.x, h.y - h.x, h.z - h.x);
    float bend = h.x + h.w - h.y - h.z;
    float side0 = uv0.x - uv0.y, side1 = uv1.x - uv1.y;
    float share = side0 * side1 < 0.0 ? side0 / (side0 - side1) : 1.0;
    float turn = mix(t0, t1, share);
    vec2 uv = mix(uv0, uv1, share);
    float gap0 = bars.direction.z * t0 - dot(plane, vec3(1.0, uv0)) - bend * min(uv0.x, uv0.y);
    float gap1 = bars.direction.z * t1 - dot(plane, vec3(1.0, uv1)) - bend * min(uv1.x, uv1.y);
    float gap_turn = bars.direction.z * turn - dot(plane, vec3(1.0, uv)) - bend * min(uv.x, uv.y);
    bool first = (is_above || gap0 > RISEN * t0) && gap_turn <= 0.0, second = gap_turn > 0.0 && gap1 <= 0.0;
    is_above = gap1 > 0.0;
    if (first || second) {
        float side = first && side0 != 0.0 ? side0 : side1;  // which of the two triangles
        slope = plane.yz + bend * (side < 0.0 ? vec2(1.0, 0.0) : vec2(0.0, 1.0));
        if (mirrored) slope.x = -slope.x;
    }
    return first ? fall(t0, gap0, turn, gap_turn) : second ? fall(turn, gap_turn, t1, gap1) : NO_HIT;
}
#endif
