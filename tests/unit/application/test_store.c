/* The store keeps the old record or has the new one, whenever the supply goes. */
#include <stdio.h>
#include <string.h>

#include "unity.h"

#include "application/bytes.h"
#include "application/crc32.h"
#include "application/store.h"
#include "support/board.h"
#include "support/random.h"

#define RECORD_BYTES 150 /* no multiple of any program unit above 2 */

static struct board *board;
static uint8_t old_record[RECORD_BYTES], new_record[RECORD_BYTES];

void setUp(void)
{
    struct random_state random = {7};
    board = board_create();
    for (size_t i = 0; i < RECORD_BYTES; i++) {
        old_record[i] = (uint8_t)random_u64(&random);
        new_record[i] = (uint8_t)random_u64(&random);
    }
}

void tearDown(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, board->bad_manners);
    board_destroy(board);
}

static bool holds(const uint8_t *record, uint32_t size)
{
    struct store_record found[HAL_STORE_SECTORS];
    uint8_t bytes[BOARD_SECTOR_BYTES];
    if (store_find(&board->hal, BOARD_SECTOR_BYTES, found) == 0 || found[0].size != size) {
        return false;
    }
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_read(&board->hal, &found[0], bytes));
    return memcmp(bytes, record, size) == 0;
}

static void an_empty_store_holds_nothing(void)
{
    struct store_record found[HAL_STORE_SECTORS];
    TEST_ASSERT_EQUAL_UINT32(0, store_find(&board->hal, BOARD_SECTOR_BYTES, found));
    memset(board->sectors, 0, sizeof board->sectors);
    TEST_ASSERT_EQUAL_UINT32(0, store_find(&board->hal, BOARD_SECTOR_BYTES, found));
}

static void the_newest_record_wins_and_the_older_sector_is_reused(void)
{
    struct store_record found[HAL_STORE_SECTORS];
    for (uint32_t round = 0; round < 7; round++) {
        old_record[0] = (uint8_t)round;
        TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
        TEST_ASSERT_TRUE(holds(old_record, RECORD_BYTES));
        TEST_ASSERT_EQUAL_UINT32(round == 0 ? 1 : 2, store_find(&board->hal, BOARD_SECTOR_BYTES, found));
        TEST_ASSERT_EQUAL_UINT32(round % 2, found[0].sector);
        TEST_ASSERT_EQUAL_UINT32(round + 1, found[0].sequence);
    }
}

static void every_program_unit_and_size(void)
{
    static const uint32_t units[] = {1, 2, 4, 8, 16, 32};
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        board->properties.store_program_bytes = units[i];
        for (uint32_t size = 0; size <= RECORD_BYTES; size++) {
            TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, new_record, size));
            TEST_ASSERT_TRUE(holds(new_record, size));
        }
    }
    TEST_ASSERT_EQUAL_INT(HAL_ERROR_ADDRESS, store_write(&board->hal, board->sectors[0], BOARD_SECTOR_BYTES - STORE_SEAL_BYTES + 1));
    TEST_ASSERT_TRUE(holds(new_record, RECORD_BYTES));
}

/* The supply goes in each operation in turn: half of that erasure or programming happens, nothing after it. */
static void power_cut_at_every_step(void)
{
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
    struct board before = *board;
    board_power_up(board);
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, new_record, RECORD_BYTES));
    uint32_t steps = board->operations;
    TEST_ASSERT_TRUE(steps >= 1 + RECORD_BYTES / 32 + 1);
    for (uint32_t step = 1; step <= steps; step++) {
        memcpy(board->sectors, before.sectors, sizeof before.sectors);
        memcpy(board->programmed, before.programmed, sizeof before.programmed);
        board_power_up(board);
        board->cut_at = step;
        TEST_ASSERT_TRUE(store_write(&board->hal, new_record, RECORD_BYTES) < 0);
        board_power_up(board);
        TEST_ASSERT_TRUE_MESSAGE(holds(old_record, RECORD_BYTES), "the old record must survive");
        TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, new_record, RECORD_BYTES));
        TEST_ASSERT_TRUE(holds(new_record, RECORD_BYTES));
    }
}

/* Power cut in every operation of 200 updates, each of a device that goes on with what the cut before has left: the device starts with the
 * old or the new record, never with neither. */
static void two_hundred_updates_with_a_cut_at_every_step(void)
{
    struct random_state random = random_begin("store", 20241121);
    uint32_t cuts = 0, old_kept = 0, new_found = 0, lost = 0;
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
    for (uint32_t update = 0; update < 200; update++) {
        bool cut = true;
        for (size_t i = 0; i < RECORD_BYTES; i++) {
            new_record[i] = (uint8_t)random_u64(&random);
        }
        for (uint32_t step = 1; cut; step++) {
            board_power_up(board);
            board->cut_at = step;
            int status = store_write(&board->hal, new_record, RECORD_BYTES);
            cut = !board->powered;
            board_power_up(board);
            bool holds_old = holds(old_record, RECORD_BYTES), holds_new = holds(new_record, RECORD_BYTES);
            TEST_ASSERT_TRUE(cut || (status == HAL_OK && holds_new));
            cuts += cut ? 1 : 0;
            old_kept += cut && holds_old ? 1 : 0;
            new_found += cut && holds_new ? 1 : 0;
            lost += holds_old || holds_new ? 0 : 1;
        }
        memcpy(old_record, new_record, RECORD_BYTES);
    }
    printf("200 updates, %u power cuts: %u times the old record, %u times the new one, %u lost\n", (unsigned)cuts, (unsigned)old_kept,
           (unsigned)new_found, (unsigned)lost);
    TEST_ASSERT_EQUAL_UINT32(0, lost);
    TEST_ASSERT_EQUAL_UINT32(cuts, old_kept + new_found);
    TEST_ASSERT_TRUE(cuts >= 200 * (2 + RECORD_BYTES / 32));
    TEST_ASSERT_EQUAL_UINT32(0, board->bad_manners);
}

/* The first record of all: nothing before, so a cut leaves nothing or everything, never half. */
static void power_cut_in_the_first_record(void)
{
    for (uint32_t step = 1; step <= 8; step++) {
        memset(board->sectors, 0xFF, sizeof board->sectors);
        memset(board->programmed, 0, sizeof board->programmed);
        board_power_up(board);
        board->cut_at = step;
        int status = store_write(&board->hal, new_record, RECORD_BYTES);
        board_power_up(board);
        TEST_ASSERT_EQUAL(status == HAL_OK, holds(new_record, RECORD_BYTES));
    }
}

static void a_changed_bit_anywhere_unseats_the_record(void)
{
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, new_record, RECORD_BYTES));
    for (size_t i = 0; i < BOARD_SECTOR_BYTES; i++) {
        bool counts = i < RECORD_BYTES || i >= BOARD_SECTOR_BYTES - STORE_SEAL_BYTES;
        for (unsigned bit = 0; bit < 8; bit++) {
            board->sectors[1][i] ^= (uint8_t)(1u << bit);
            TEST_ASSERT_EQUAL(!counts, holds(new_record, RECORD_BYTES));
            TEST_ASSERT_TRUE(!counts || holds(old_record, RECORD_BYTES));
            board->sectors[1][i] ^= (uint8_t)(1u << bit);
        }
    }
}

/* The seal of the only record rewritten with the last number, as 2^32 writings would leave it. */
static void the_sequence_number_may_wrap(void)
{
    struct store_record found[HAL_STORE_SECTORS];
    TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, old_record, RECORD_BYTES));
    uint8_t *seal = &board->sectors[0][BOARD_SECTOR_BYTES - STORE_SEAL_BYTES];
    struct byte_writer writer = {seal + 4};
    put_u32(&writer, UINT32_MAX - 1);
    put_u32(&writer, RECORD_BYTES);
    writer.next = seal + STORE_SEAL_BYTES - 4;
    put_u32(&writer, crc32_update(crc32_update(0, old_record, RECORD_BYTES), seal, 12));
    TEST_ASSERT_TRUE(holds(old_record, RECORD_BYTES));
    for (uint32_t round = 0; round < 5; round++) {
        new_record[0] = (uint8_t)round;
        TEST_ASSERT_EQUAL_INT(HAL_OK, store_write(&board->hal, new_record, RECORD_BYTES));
        TEST_ASSERT_TRUE(holds(new_record, RECORD_BYTES));
        store_find(&board->hal, BOARD_SECTOR_BYTES, found);
        TEST_ASSERT_EQUAL_UINT32(UINT32_MAX + round, found[0].sequence);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(an_empty_store_holds_nothing);
    RUN_TEST(the_newest_record_wins_and_the_older_sector_is_reused);
    RUN_TEST(every_program_unit_and_size);
    RUN_TEST(power_cut_at_every_step);
    RUN_TEST(two_hundred_updates_with_a_cut_at_every_step);
    RUN_TEST(power_cut_in_the_first_record);
    RUN_TEST(a_changed_bit_anywhere_unseats_the_record);
    RUN_TEST(the_sequence_number_may_wrap);
    return UNITY_END();
}
