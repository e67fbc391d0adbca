/* A few numbers that the interrupt publishes once per slow tick for the background (sequence lock: one writer that never waits,
 * readers that try again). */
#ifndef WINEGLASS_APPLICATION_LIVE_H
#define WINEGLASS_APPLICATION_LIVE_H

#include <stdatomic.h>
#include <stdint.h>

struct live {
    uint64_t sample_counter; /* samples done */
    uint32_t status;         /* enum gyro_status */
    uint32_t acquisition_attempt;
};

struct live_lock {
    _Atomic uint32_t turn; /* odd while the writer is inside */
    _Atomic uint32_t counter_low, counter_high, status, acquisition_attempt;
};

static inline void live_publish(struct live_lock *lock, struct live live)
{
    uint32_t turn = atomic_load_explicit(&lock->turn, memory_order_relaxed);
    atomic_store_explicit(&lock->turn, turn + 1, memory_order_relaxed);
    atomic_thread_fence(memory_order_release);
    atomic_store_explicit(&lock->counter_low, (uint32_t)live.sample_counter, memory_order_relaxed);
    atomic_store_explicit(&lock->counter_high, (uint32_t)(live.sample_counter >> 32), memory_order_relaxed);
    atomic_store_explicit(&lock->status, live.status, memory_order_relaxed);
    atomic_store_explicit(&lock->acquisition_attempt, live.acquisition_attempt, memory_order_relaxed);
    atomic_store_explicit(&lock->turn, turn + 2, memory_order_release);
}

static inline struct live live_read(struct live_lock *lock)
{
    struct live live;
    uint32_t before, after;
    do {
        before = atomic_load_explicit(&lock->turn, memory_order_acquire);
        live.sample_counter = atomic_load_explicit(&lock->counter_low, memory_order_relaxed);
        live.sample_counter |= (uint64_t)atomic_load_explicit(&lock->counter_high, memory_order_relaxed) << 32;
        live.status = atomic_load_explicit(&lock->status, memory_order_relaxed);
        live.acquisition_attempt = atomic_load_explicit(&lock->acquisition_attempt, memory_order_relaxed);
        atomic_thread_fence(memory_order_acquire);
        after = atomic_load_explicit(&lock->turn, memory_order_relaxed);
    } while (before != after || (before & 1) != 0);
    return live;
}

#endif
