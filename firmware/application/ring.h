/* Indices of a ring with one writer (the interrupt) and one reader (the background). The capacity is a power of two; the elements
 * stand in an array of the owner's. */
#ifndef WINEGLASS_APPLICATION_RING_H
#define WINEGLASS_APPLICATION_RING_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct ring {
    _Atomic uint32_t written, taken; /* counts modulo 2^32 */
};

/* Writer: index of the free slot, then ring_put; false when the ring is full. */
static inline bool ring_slot(struct ring *ring, uint32_t capacity, uint32_t *index)
{
    uint32_t written = atomic_load_explicit(&ring->written, memory_order_relaxed);
    uint32_t taken = atomic_load_explicit(&ring->taken, memory_order_acquire);
    *index = written & (capacity - 1);
    return written - taken < capacity;
}

static inline void ring_put(struct ring *ring)
{
    uint32_t written = atomic_load_explicit(&ring->written, memory_order_relaxed);
    atomic_store_explicit(&ring->written, written + 1, memory_order_release);
}

/* Reader: how many elements wait, the index of the one that is `ahead` places behind the oldest, and dropping the oldest ones. */
static inline uint32_t ring_waiting(struct ring *ring)
{
    uint32_t taken = atomic_load_explicit(&ring->taken, memory_order_relaxed);
    return atomic_load_explicit(&ring->written, memory_order_acquire) - taken;
}

static inline uint32_t ring_index(struct ring *ring, uint32_t capacity, uint32_t ahead)
{
    return (atomic_load_explicit(&ring->taken, memory_order_relaxed) + ahead) & (capacity - 1);
}

static inline void ring_drop(struct ring *ring, uint32_t count)
{
    uint32_t taken = atomic_load_explicit(&ring->taken, memory_order_relaxed);
    atomic_store_explicit(&ring->taken, taken + count, memory_order_release);
}

#endif
