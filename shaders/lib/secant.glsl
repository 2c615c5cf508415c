// From a point in the ground back to the surface, along the sight ray. Include after lib/packed.glsl.
const int MOST_STEPS = 6, STEPS_BACK = 6;

// Where the ray was last above the ground between `entry` and the hit; the hit if nowhere.
float last_above(vec3 sight, float hit, float entry) {
    const int SAMPLES = 8;
    for (int i = 1; i <= SAMPLES; ++i) {
        float at = mix(hit, entry, float(i) / float(SAMPLES));
        if (depth_below(sight, at) < 0.0) return at;
    }
    return hit;
}

// Where the ray meets the ground between `above` and `under`: secant steps that halve the weight of an end which stays
// (Illinois), so that no bend of the ground can stall them. Stops where the point lies within `enough_m` of the surface.
// Where the ray was in the ground before, along the border of a neighbouring box, it goes back by `stride`, and ever
// longer.
float surface_at(vec3 sight, float under, float above, float stride, float enough_m) {
    float high = depth_below(sight, above), deep = depth_below(sight, under);
    for (int i = 0; i < STEPS_BACK && high >= 0.0; ++i) {
        under = above;
        deep = high;
        above = max(above - stride, 0.0);
        stride *= 2.0;
        high = depth_below(sight, above);
    }
    if (high >= 0.0) return above;
    float found = mix(above, under, clamp(high / min(high - deep, -1e-6), 0.0, 1.0)), last = 0.0;
    for (int i = 0; i < MOST_STEPS; ++i) {
        float depth = depth_below(sight, found);
        if (depth < 0.0) {
            above = found;
            high = depth;
            if (last < 0.0) deep *= 0.5;
        } else {
            under = found;
            deep = depth;
            if (last > 0.0) high *= 0.5;
        }
        last = depth;
        if (abs(depth) < enough_m) break;
        found = mix(above, under, clamp(high / min(high - deep, -1e-6), 0.0, 1.0));
    }
    return found;
}
