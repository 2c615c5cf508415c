// Colours of the debug views.

// One colour per level of detail, blended between levels: eight hues that stay apart for colour-blind eyes
// (Okabe and Ito, 2008), repeated.
vec3 level_colour(float level) {
    const vec3 hue[8] = vec3[8](vec3(0.00, 0.45, 0.70), vec3(0.90, 0.62, 0.00), vec3(0.00, 0.62, 0.45),
                                vec3(0.80, 0.47, 0.65), vec3(0.34, 0.71, 0.91), vec3(0.84, 0.37, 0.00),
                                vec3(0.94, 0.89, 0.26), vec3(0.60, 0.60, 0.60));
    int below = int(floor(max(level, 0.0)));
    return mix(hue[below & 7], hue[(below + 1) & 7], fract(max(level, 0.0)));
}

// The normal of the drawn surface (not of the shading), world axes, as a colour: 0.5 + 0.5 n.
vec3 normal_colour(vec3 position_m) {
    vec3 normal = normalize(cross(dFdx(position_m), dFdy(position_m)));
    if (dot(normal, position_m) > 0.0) normal = -normal;
    return 0.5 + 0.5 * vec3(normal.x, -normal.z, normal.y);
}
