/* A growing first-in first-out queue of bytes. */
#ifndef HAL_HOST_HOST_QUEUE_H
#define HAL_HOST_HOST_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Empty when all zero. */
struct host_queue {
    uint8_t *bytes;
    size_t capacity, first, count; /* the content stands at bytes[first] .. bytes[first + count - 1] */
};

bool host_queue_put(struct host_queue *queue, const uint8_t *bytes, size_t count); /* false: no memory, nothing changed */
size_t host_queue_take(struct host_queue *queue, uint8_t *bytes, size_t capacity);
void host_queue_free(struct host_queue *queue);

#endif
