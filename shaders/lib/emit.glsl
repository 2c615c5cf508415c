// Vertex stage: hands a point of the surface to mesh.frag. Include after lib/frame.glsl.
#include "lib/needs.glsl"

out vec2 v_ground;  // texture coordinate of the ground textures
#ifdef POSITION_VARYING
out vec3 v_position_m;  // relative to the eye
#endif
#ifdef OUTPUT_LEVELS
out float v_level;
#endif

// position_m: relative to the eye; post: fractional (col, row); level: level of detail, 0 the finest.
void emit_surface(vec3 position_m, vec2 post, float level) {
    gl_Position = u_clip_from_eye * vec4(position_m, 1.0);
#if defined(OUTPUT_FLAT) && !defined(LOG_DEPTH)
    gl_Position.z *= 1.0005;  // lines lie on the triangles they bound: half a per mille of the distance nearer
#endif
    v_ground = (post + 0.5) / u_grid.xy;
#ifdef POSITION_VARYING
    v_position_m = position_m;
#endif
#ifdef OUTPUT_LEVELS
    v_level = level;
#endif
#ifdef CLIP_EDGES
    // Cells may reach past the grid's far edges; what lies outside is cut off.
    gl_ClipDistance[0] = u_grid.x - 1.0 - post.x;
    gl_ClipDistance[1] = u_grid.y - 1.0 - post.y;
#endif
}
