/* Why a command or a calibration block was refused. The numbers are part of the protocol: never renumber, only append. */
#ifndef WINEGLASS_APPLICATION_REASON_H
#define WINEGLASS_APPLICATION_REASON_H

enum reason {
    REASON_OK = 0,
    REASON_UNKNOWN_COMMAND = 1,
    REASON_FRAME_VERSION = 2,
    REASON_LENGTH = 3,
    REASON_OUT_OF_RANGE = 4,
    REASON_LOCKED = 5,               /* calibration is locked */
    REASON_WRONG_KEY = 6,
    REASON_BUSY = 7,                 /* a raw burst is being recorded, or the phases are being calibrated */
    REASON_NOTHING_STORED = 8,       /* no calibration block to read */
    REASON_STORE_FAILED = 9,
    REASON_UNSTABLE = 10,            /* the rebalance loop would have too little margin */
    REASON_NOT_LOCKED = 11,          /* phase calibration needs a locked drive loop */
    REASON_NO_RESULT = 12,           /* no phase calibration has been done */
    REASON_CALIBRATION_SIZE = 16,
    REASON_CALIBRATION_MAGIC = 17,
    REASON_CALIBRATION_VERSION = 18,
    REASON_CALIBRATION_CRC = 19,
    REASON_CALIBRATION_RANGE = 20,   /* a field is outside its range */
    REASON_CALIBRATION_CONFLICT = 21,/* fields contradict each other */
    REASON_CALIBRATION_BOARD = 22,   /* made for another sampling rate */
    REASON_CALIBRATION_UNSTABLE = 23,/* its rebalance loop would have too little margin */
    REASON_SNAPSHOT_VERSION = 24,    /* or size */
    REASON_SNAPSHOT_RANGE = 25,      /* a number that the signal processing does not leave there */
    REASON_SNAPSHOT_BOARD = 26       /* taken with other converters */
};

/* A few words for people; never NULL. */
const char *reason_text(enum reason reason);

#endif
