#version 330 core
// Casts one sight ray per pixel: down and up the multilevel height map, then through the surface of single cells.
// Source: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering", section 3.
// The two inner loops are kept apart because software GL runs a loop for eight pixels at once, as long as the slowest.
#include "lib/frame.glsl"
#include "lib/surface.glsl"
#include "lib/bars.glsl"
#include "lib/cells.glsl"
// Neighbouring pixels may lie on different hills: the ground's textures are filtered by the surface's own change.
mat2 ground_change;
#define texture(image, place) textureGrad(image, place, ground_change[0], ground_change[1])
#ifdef HOLES  // are found on the way, not when the hit is shaded: the ray goes on behind them
#undef HOLES
#define PASS_HOLES
#if !defined(OUTPUT_SHADED) && !defined(OUTPUT_LEVELS)
uniform sampler2D u_ground;
#endif
#endif
#include "lib/output.glsl"
#undef texture
#ifdef PLANE
#include "lib/light.glsl"
uniform vec3 u_albedo;
#endif

uniform sampler2D u_pyramid;     // (a, b, upper, lower) of nodes of 2^level cells, level - 1 as mip level
uniform sampler2D u_extra0;      // per block of pixels: where its rays may start, and at which level
uniform float u_blocks_per_px;
uniform float u_thickness;       // level of detail: planes this far apart per metre of distance count as one
uniform vec3 u_chosen_eye;       // map coordinates relative to the eye: distance counts from where detail was chosen
uniform vec2 u_cell_m;           // size of a cell along the base plane [m]
uniform int u_step_limit;
uniform vec2 u_view_scale;       // level view: x times the level plus y times the number of steps
in vec2 v_screen;

// No more than the distance [m] to any point of a node's upper plane: a measure of the node and not of the ray, or
// neighbouring rays would see different surfaces, and gaps between them.
float least_distance(vec4 bound, ivec2 corner, int size) {
    float half_size = 0.5 * float(size);
    vec2 across = corner_from_eye(corner) + half_size;
    float height = (bound.z - u_eye_map.z) - u_eye_map.w + half_size * (bound.x + bound.y);
    vec3 centre = vec3(across, height) - u_chosen_eye;
    vec3 reach = half_size * vec3(u_cell_m, abs(bound.x) + abs(bound.y));
    return length(vec3(centre.xy * u_cell_m, centre.z)) - length(reach);
}

void main() {
    vec3 sight = sight_ray(v_screen);
    Bars bars = bars_along(sight);
    vec2 way = clip_to_map(bars);
    vec2 start = texelFetch(u_extra0, ivec2(gl_FragCoord.xy * u_blocks_per_px), 0).rg;
    float t = max(max(way.x, u_eye_height.z), start.x), t_end = way.y;
    int level = clamp(int(start.y), 1, u_top_level), steps = 0;
    ivec2 cell = cell_at(bars, t, ivec2(0), max(u_cells.x, u_cells.y));
    bool is_above = true, is_hit = false;
    vec2 slope = vec2(0.0);
#ifdef FROM_BELOW
    if (t < t_end) {
        vec4 h = corners_from_eye(cell);
        vec2 uv = clamp(bars.direction.xy * t - corner_from_eye(cell), 0.0, 1.0);
        is_above = bars.direction.z * t > cell_height(h, uv, is_nw_se(cell));
    }
#endif
    if (t < t_end) {
        do {
            bool is_leaf, is_met;
            do {  // over nodes
                ivec2 node = cell >> level;
                vec4 bound = texelFetch(u_pyramid, node, level - 1);
                bool is_thin = bound.z - bound.w <= u_thickness * least_distance(bound, node << level, 1 << level);
                // Always the coarsest thin node, whichever way the ray came: or neighbouring rays would see different
                // surfaces, and gaps between them.
                while (is_thin && level < u_top_level) {
                    vec4 wider = texelFetch(u_pyramid, node >> 1, level);
                    node >>= 1;
                    if (wider.z - wider.w > u_thickness * least_distance(wider, node << (level + 1), 2 << level)) break;
                    bound = wider;
                    ++level;
                }
                node = cell >> level;
                ivec2 corner = node << level;
                int size = 1 << level;
                vec2 leave = leave_square(bars, corner, size);
                float t1 = min(min(leave.x, leave.y), t_end);
#ifdef FROM_BELOW
                float height = is_above ? bound.z : bound.w, side = is_above ? 1.0 : -1.0;
#else
                const float side = 1.0;
                float height = bound.z;
#endif
                slope = bound.xy;
                height = is_thin ? 0.5 * (bound.z + bound.w) : height;
                vec2 gap = gap_to_plane(bars, bound.xy, height, corner_from_eye(corner));
                float gap0 = gap.x + gap.y * t, gap1 = gap.x + gap.y * t1;
                // Middle planes of neighbours do not meet: below one at its rim is a hit too, the step between them.
                is_met = is_thin && (is_above ? min(gap0, gap1) <= 0.0 : gap0 > RISEN * t && gap1 <= 0.0);
                bool is_passed = !is_met && (is_thin || min(side * gap0, side * gap1) > 0.0);
                is_leaf = !is_met && !is_passed && level == 1;
#ifdef FROM_BELOW
                is_above = is_thin ? gap1 > 0.0 : is_above;
#endif
                t = is_passed ? t1 : (is_met ? gap0 : side * gap0) > 0.0 ? clamp(-gap.x / gap.y, t, t1) : t;
                ivec2 next = cell_at(bars, t, corner, size);
                if (is_passed && leave.x <= t1) next.x = corner.x + bars.ahead.x * (size + 1) - 1;
                else if (is_passed && leave.y <= t1) next.y = corner.y + bars.ahead.y * (size + 1) - 1;
                ivec2 parent = (next >> (level + 1)) ^ (node >> 1);
                int up = (parent.x | parent.y) != 0 ? 1 : 0;
                cell = next;
                level = is_met ? level : clamp(level + (is_passed ? up : -1), 1, u_top_level);
                ++steps;
            } while (!is_leaf && !is_met && t < t_end && steps < u_step_limit);
            is_hit = is_met;
            if (is_leaf) {
                // Over the cells of a node of 2 x 2, until one outside is reached: a ray through a corner takes two steps
                // at one t.
                ivec2 node = cell >> 1;
                do {
                    vec2 leave = leave_square(bars, cell, 1);
                    float t2 = min(min(leave.x, leave.y), t_end);
                    float hit = cross_cell(bars, cell, t, t2, is_above, slope);
                    is_hit = hit != NO_HIT;
                    t = is_hit ? hit : t2;
                    if (!is_hit && leave.x <= t2) cell.x += 2 * bars.ahead.x - 1;
                    else if (!is_hit && leave.y <= t2) cell.y += 2 * bars.ahead.y - 1;
                } while (!is_hit && t < t_end && cell >> 1 == node);
                level = is_hit ? 0 : 1;
            }
#ifdef PASS_HOLES
            // Ground without data is passed through. Filtered like the mesh's; but rays of a quad share a mip level, so that
            // beside a silhouette the texture itself has a say, and the last word where it holds no data at all.
            vec2 place = (vec2(u_eye_cell) + u_eye_map.xy + bars.direction.xy * t + 0.5) / u_grid.xy;
            mat2 change = posts_per_pixel(bars, slope, t);
            float data = textureGrad(u_ground, place, change[0] / u_grid.xy, change[1] / u_grid.xy).a;
            float finest = textureLod(u_ground, place, 0.0).a;
            bool is_open = finest == 0.0 || max(data, finest) < 0.5;
            if (is_hit) is_above = !is_open;
            is_hit = is_hit && !is_open;
            level = is_hit ? level : max(level, 1);
#endif
        } while (!is_hit && t < t_end && steps < u_step_limit);
        // Where the steps run out the ray is above the surface and in a node that holds it: that is the hit.
        is_hit = is_hit || (steps >= u_step_limit && t < t_end && is_above);
    }
    vec2 post = vec2(u_eye_cell) + u_eye_map.xy + bars.direction.xy * t;
    ground_change = posts_per_pixel(bars, slope, t);
    ground_change = mat2(ground_change[0] / (vec2(u_cells) + 1.0), ground_change[1] / (vec2(u_cells) + 1.0));
    write_surface(sight * t, (post + 0.5) / (vec2(u_cells) + 1.0), dot(u_view_scale, vec2(level, steps)));
#ifdef COUNT_STEPS
    out_count = float(steps);
    return;
#endif
    if (!is_hit) discard;
#if defined(PLANE) && defined(OUTPUT_SHADED)
    vec4 h = corners_from_eye(cell);
    vec2 uv = clamp(bars.direction.xy * t - corner_from_eye(cell), 0.0, 1.0);
    slope = vec2(mix(h.y - h.x, h.w - h.z, uv.y), mix(h.z - h.x, h.w - h.y, uv.x));
    vec3 normal = normalize(vec3(-slope, 1.0) * u_map_from_world);  // normals go by the inverse transpose
    float bounce = 0.25 * (1.0 - normal.y) + 0.06;  // light from the ground below
    vec3 light = u_sunlight.rgb * (max(dot(normal, u_sun.xyz), 0.0) + bounce * u_sun.y)
                 + u_sky_light.rgb * (0.5 + 0.5 * normal.y);
    out_colour = vec4(display_colour(u_albedo * u_albedo * light), 1.0);
#ifdef FOG
    out_colour.rgb = apply_fog(out_colour.rgb, sight * t);
#endif
#endif
#ifdef OUTPUT_FLAT
    // Rays have no triangles: the wireframe view shows the squares they ended in.
    vec2 square = (post - vec2((cell >> level) << level)) / float(1 << level), per_px = fwidth(post) / float(1 << level);
    vec2 line = min(square, 1.0 - square) / max(per_px, 1e-6);
    if (min(line.x, line.y) > 0.7) discard;
    t *= 0.9995;  // before the surface
#endif
    gl_FragDepth = depth_at(t);
}
