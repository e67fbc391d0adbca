/* Frames about the device itself: identity, status, answers to commands, the stored calibration. Background. */
#ifndef WINEGLASS_APPLICATION_REPORTS_H
#define WINEGLASS_APPLICATION_REPORTS_H

#include "application/application.h"

/* Identity, and the board's self-test if it has one. */
void report_identity(struct application *app);
/* Result of the last phase calibration. */
void report_phases(struct application *app);

void report_status(struct application *app);
void report_ack(struct application *app, const struct frame_header *command, enum reason reason);

/* Sends the newest record of the store; REASON_NOTHING_STORED or REASON_STORE_FAILED when there is none. */
enum reason report_calibration(struct application *app);

#endif
