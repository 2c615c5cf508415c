// Vertex stage: straight lines of a width in pixels (core profiles draw only thin ones). Include after lib/frame.glsl.
noperspective out float v_across_px;  // distance from the line's middle

// Corner 0..3 of the quad that covers the line from a to b (relative to the eye [m]).
void emit_line(vec3 a_m, vec3 b_m, int corner, float width_px) {
    vec4 a = u_clip_from_eye * vec4(a_m, 1.0), b = u_clip_from_eye * vec4(b_m, 1.0);
    float near_m = u_eye_height.z;
    v_across_px = 0.0;
    gl_Position = vec4(2.0, 2.0, 0.0, 1.0);  // outside the picture
    if (max(a.w, b.w) <= near_m) return;
    if (a.w < near_m) a = mix(a, b, (near_m - a.w) / (b.w - a.w));  // what lies behind the eye has no place on the screen
    if (b.w < near_m) b = mix(b, a, (near_m - b.w) / (a.w - b.w));
    vec2 along = (b.xy / b.w - a.xy / a.w) * u_viewport.xy;
    along = dot(along, along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
    float side = (corner & 1) == 0 ? -1.0 : 1.0;
    v_across_px = side * (0.5 * width_px + 1.0);
    gl_Position = (corner & 2) == 0 ? a : b;
    gl_Position.xy += vec2(-along.y, along.x) * v_across_px * 2.0 * u_viewport.zw * gl_Position.w;
#ifndef LOG_DEPTH
    gl_Position.z *= 1.001;  // lines that lie on the ground stay visible
#endif
}
