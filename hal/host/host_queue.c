#include "hal/host/host_queue.h"

#include <stdlib.h>
#include <string.h>

#define LEAST_CAPACITY 4096

/* Room for `more` bytes behind the content: first by moving the content to the front, then by doubling. */
static bool make_room(struct host_queue *queue, size_t more)
{
    size_t needed = queue->count + more;
    if (needed <= queue->capacity / 2 || (needed <= queue->capacity && queue->first > queue->capacity / 2)) {
        memmove(queue->bytes, queue->bytes + queue->first, queue->count);
        queue->first = 0;
        return true;
    }
    size_t capacity = queue->capacity > 0 ? queue->capacity : LEAST_CAPACITY;
    while (capacity < queue->first + needed) {
        capacity *= 2;
    }
    uint8_t *bytes = realloc(queue->bytes, capacity);
    if (bytes == NULL) {
        return false;
    }
    queue->bytes = bytes;
    queue->capacity = capacity;
    return true;
}

bool host_queue_put(struct host_queue *queue, const uint8_t *bytes, size_t count)
{
    if (queue->first + queue->count + count > queue->capacity && !make_room(queue, count)) {
        return false;
    }
    if (count > 0) {
        memcpy(queue->bytes + queue->first + queue->count, bytes, count);
    }
    queue->count += count;
    return true;
}

size_t host_queue_take(struct host_queue *queue, uint8_t *bytes, size_t capacity)
{
    size_t count = queue->count < capacity ? queue->count : capacity;
    if (count > 0) {
        memcpy(bytes, queue->bytes + queue->first, count);
    }
    queue->first += count;
    queue->count -= count;
    if (queue->count == 0) {
        queue->first = 0;
    }
    return count;
}

void host_queue_free(struct host_queue *queue)
{
    free(queue->bytes);
    *queue = (struct host_queue){NULL, 0, 0, 0};
}
