// What a fragment needs to be told, derived from what it writes: every varying costs triangle setup.
#if defined(OUTPUT_POSITION) || defined(OUTPUT_NORMALS)
#define POSITION_VARYING  // to full precision, from the vertex stage
#endif
#if defined(OUTPUT_SHADED) && (defined(HEIGHT_FOG) || defined(CONTOURS))
#define POSITION_FROM_DEPTH  // good enough for shading, and free of varyings
#elif defined(OUTPUT_SHADED) && defined(FOG)
#define DISTANCE_FROM_DEPTH  // of the position only its distance is read
#endif
#if defined(POSITION_VARYING) || defined(POSITION_FROM_DEPTH) || defined(DISTANCE_FROM_DEPTH)
#define NEEDS_POSITION
#endif
