// What a fragment needs to be told, derived from what it writes: every varying costs triangle setup.
#if defined(OUTPUT_POSITION) || defined(OUTPUT_NORMALS) || defined(FOG) || defined(CONTOURS) || defined(WATER)
#define NEEDS_POSITION
#endif
