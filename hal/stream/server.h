/* A device that is driven by requests on a stream. One request, one answer; all numbers are little-endian 32-bit words unless said
 * otherwise. A request is its kind, the number of bytes that follow, and those bytes; an answer is the number of bytes that follow,
 * and those bytes. The stream's end stops the server.
 *
 *   kind      bytes                                                     answer
 *   START     serial (64 bit), sample rate in 1/1000 Hz, ADC bits,      status, 0 or negative
 *             DAC bits, loop delay (Q16 samples), program unit,
 *             poll interval, calibration block (may be missing)
 *   RUN       thermometer code, then n pairs of ADC codes               n pairs of DAC codes
 *   COMMAND   command bytes for the device                              status, 0 or -1 (no room)
 *   POLL                                                                status 0
 *   DRAIN                                                               telemetry bytes, as many as fit into an answer
 *   SNAPSHOT                                                            configuration and state (docs/SPEC.md, snapshot frames)
 *
 * A request that is none of these, or has a wrong length, ends the server with status SERVER_BAD_REQUEST. */
#ifndef HAL_STREAM_SERVER_H
#define HAL_STREAM_SERVER_H

enum server_request { SERVER_START = 1, SERVER_RUN, SERVER_COMMAND, SERVER_POLL, SERVER_DRAIN, SERVER_SNAPSHOT };

#define SERVER_MAX_BYTES   (256u * 1024u) /* of a request or an answer */
#define SERVER_BAD_REQUEST 2

/* Serves until the stream ends (0) or breaks the rules (SERVER_BAD_REQUEST). */
int server_run(void);

#endif
