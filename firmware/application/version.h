/* Version of the firmware, as identity frames report it. */
#ifndef WINEGLASS_APPLICATION_VERSION_H
#define WINEGLASS_APPLICATION_VERSION_H

#define FIRMWARE_VERSION_MAJOR 0
#define FIRMWARE_VERSION_MINOR 1
#define FIRMWARE_VERSION_PATCH 0

/* The build may set it to a checksum of the sources; 0 says that it did not. */
#ifndef WINEGLASS_BUILD_ID
#define WINEGLASS_BUILD_ID 0
#endif

#endif
