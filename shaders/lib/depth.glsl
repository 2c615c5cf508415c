// Depth of a point from its view depth [m]: larger is nearer, 0 is infinitely far. Include after lib/frame.glsl.
float depth_at(float view_depth_m) {
#ifdef LOG_DEPTH
    // Without clip control: log2 of the distance, from the near plane to 1e8 m.
    return 1.0 - log2(max(view_depth_m, u_eye_height.z) / u_eye_height.z) / log2(1e8 / u_eye_height.z);
#else
    return u_eye_height.z / view_depth_m;  // reversed z
#endif
}

// Twin of Camera.clip_from_eye for whoever finds positions in the fragment stage.
float depth_of(vec3 position_m) {
    return depth_at(dot(vec3(u_clip_from_eye[0].w, u_clip_from_eye[1].w, u_clip_from_eye[2].w), position_m));
}
