/* Marks the functions that the shared library wineglass_twin shows to the outside; everything else stays hidden. */
#ifndef HAL_HOST_WG_EXPORT_H
#define HAL_HOST_WG_EXPORT_H

#if defined(__GNUC__)
#define WG_EXPORT __attribute__((visibility("default")))
#else
#define WG_EXPORT
#endif

#endif
