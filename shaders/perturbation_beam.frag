#version 330 core
// One bundle of rays per block of pixels: how far all of them surely stay above the surface, and at which level of the
// multilevel height map to go on. A bundle is a pyramid around its middle ray; the rays at its corners are its edges, so
// the lowest of them against a node's plane is the exact bound of all. The planes hold half a node further out.
#include "lib/frame.glsl"
#include "lib/bars.glsl"

uniform sampler2D u_extra1;  // widened planes (a, b, upper, lower) of nodes of 2^level cells, level - 2 as mip level
uniform float u_block_px;
out vec4 out_start;          // x: t, y: level

const float NEVER = 1e30;
const int STEP_LIMIT = 256;

void main() {
    vec3 across = 0.5 * u_block_px * u_viewport.z * u_ray[1].xyz, up = 0.5 * u_block_px * u_viewport.w * u_ray[2].xyz;
    Bars bars = bars_along(sight_ray(gl_FragCoord.xy * u_block_px * u_viewport.zw));
    vec3 side = u_map_from_world * across, head = u_map_from_world * up;
    vec2 reach = abs(side.xy) + abs(head.xy);  // per t: how far the bundle reaches to either side of its middle
    float width = max(reach.x, reach.y), lowest = bars.direction.z - abs(side.z) - abs(head.z);

    vec2 way = clip_to_map(bars);
    // Where the bundle's first ray comes over the map, and where its lowest comes down to the highest point.
    vec2 west_north = vec2(-u_eye_cell) - u_eye_map.xy, east_south = vec2(u_cells - u_eye_cell) - u_eye_map.xy;
    vec2 towards = max(bars.direction.xy + reach, 1e-20), back = min(bars.direction.xy - reach, -1e-20);
    vec2 over = max(max(west_north / towards, east_south / back), 0.0);
    float first = max(over.x, over.y);
    if (u_range.y < 0.0) first = max(first, lowest < 0.0 ? u_range.y / lowest : NEVER);

    // Between `first` and the middle ray's entry rays may be over the map already: the first node must hold that too.
    float t = max(way.x, first), t_end = way.y;
    int level = u_top_level;
    if (t < t_end) {
        ivec2 cell = cell_at(bars, t, ivec2(0), max(u_cells.x, u_cells.y));
        bool is_done = false;
        int steps = 0;
        do {
            ivec2 node = cell >> level, corner = node << level;
            int size = 1 << level;
            vec4 bound = texelFetch(u_extra1, node, level - 2);
            vec2 leave = leave_square(bars, corner, size), from = corner_from_eye(corner);
            float t1 = min(min(leave.x, leave.y), t_end);
            vec2 gap = gap_to_plane(bars, bound.xy, bound.z, from);
            gap.y -= abs(side.z - dot(bound.xy, side.xy)) + abs(head.z - dot(bound.xy, head.xy));
            float gap0 = gap.x + gap.y * first, gap1 = gap.x + gap.y * t1;
            float room = 0.5 * float(size) - max(abs(bars.direction.x), abs(bars.direction.y)) * (t - first);
            bool fits = width * t1 <= room, is_passed = fits && min(gap0, gap1) > 0.0;
            // Finer nodes would be narrower than the bundle: what is left is for the single rays.
            bool can_descend = fits && level > 2 && width * t1 <= 0.25 * room;
            if (fits && gap0 > 0.0) first = is_passed ? t1 : clamp(-gap.x / gap.y, first, t1);
            t = max(t, first);
            ivec2 next = cell_at(bars, t, corner, size);
            if (is_passed && leave.x <= t1) next.x = corner.x + bars.ahead.x * (size + 1) - 1;
            else if (is_passed && leave.y <= t1) next.y = corner.y + bars.ahead.y * (size + 1) - 1;
            ivec2 parent = (next >> (level + 1)) ^ (node >> 1);
            cell = next;
            is_done = !is_passed && !can_descend;
            level = is_done ? level : clamp(level + (is_passed ? ((parent.x | parent.y) != 0 ? 1 : 0) : -1), 2, u_top_level);
            ++steps;
        } while (!is_done && first < t_end && steps < STEP_LIMIT);
    }
    out_start = vec4(first, float(level), 0.0, 1.0);
}
