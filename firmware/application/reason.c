#include "application/reason.h"

const char *reason_text(enum reason reason)
{
    switch (reason) {
    case REASON_OK:
        return "accepted";
    case REASON_UNKNOWN_COMMAND:
        return "unknown command";
    case REASON_FRAME_VERSION:
        return "unknown frame version";
    case REASON_LENGTH:
        return "wrong length";
    case REASON_OUT_OF_RANGE:
        return "parameter out of range";
    case REASON_LOCKED:
        return "calibration is locked";
    case REASON_WRONG_KEY:
        return "wrong key";
    case REASON_BUSY:
        return "busy with a raw burst or a phase calibration";
    case REASON_NOTHING_STORED:
        return "no calibration stored";
    case REASON_STORE_FAILED:
        return "store failed";
    case REASON_UNSTABLE:
        return "the rebalance loop would be unstable";
    case REASON_NOT_LOCKED:
        return "the drive loop is not locked";
    case REASON_NO_RESULT:
        return "no phase calibration has been done";
    case REASON_CALIBRATION_SIZE:
        return "calibration block: wrong size";
    case REASON_CALIBRATION_MAGIC:
        return "not a calibration block";
    case REASON_CALIBRATION_VERSION:
        return "calibration block: unknown version";
    case REASON_CALIBRATION_CRC:
        return "calibration block: wrong CRC";
    case REASON_CALIBRATION_RANGE:
        return "calibration block: field out of range";
    case REASON_CALIBRATION_CONFLICT:
        return "calibration block: fields contradict each other";
    case REASON_CALIBRATION_BOARD:
        return "calibration block: made for another sampling rate";
    case REASON_CALIBRATION_UNSTABLE:
        return "calibration block: the rebalance loop would be unstable";
    case REASON_SNAPSHOT_VERSION:
        return "snapshot: unknown version or wrong size";
    case REASON_SNAPSHOT_RANGE:
        return "snapshot: a number out of range";
    case REASON_SNAPSHOT_BOARD:
        return "snapshot: taken with other converters";
    }
    return "unknown reason";
}
