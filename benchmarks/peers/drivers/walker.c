/* What reading a .tlog can cost at the least: from record to record with every checksum, and nothing decoded.
 *
 *     walker RECORDING      prints NAME=COUNT of the messages to count
 *
 * A record is a receive time of 8 bytes and a MAVLink frame. Where there is none, the next one is looked for a byte
 * further. The file is read a mebibyte at a time. crc_extras.h is written by crc_extras.py.
 */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "crc_extras.h"

#define LENGTH(array) (sizeof(array) / sizeof((array)[0]))

enum { STAMP = 8, CRC = 2, SIGNATURE = 13, LONGEST = STAMP + 10 + 255 + CRC + SIGNATURE, PIECE = 1 << 20, IDS = 1 << 16 };

static uint16_t table[8][256];    /* the checksum of a byte with 0 to 7 bytes behind it */
static int16_t crc_extra[IDS];    /* by id; -1 where it is unknown */
static uint64_t counts[IDS];      /* by id */
static uint8_t buffer[PIECE + LONGEST];

static void make_tables(void) {
    for (int byte = 0; byte < 256; byte++) {
        uint16_t crc = (uint16_t)byte;
        for (int bit = 0; bit < 8; bit++) crc = (uint16_t)(crc & 1 ? crc >> 1 ^ 0x8408 : crc >> 1);
        table[0][byte] = crc;
    }
    for (int behind = 1; behind < 8; behind++)
        for (int byte = 0; byte < 256; byte++) {
            uint16_t crc = table[behind - 1][byte];
            table[behind][byte] = (uint16_t)(crc >> 8 ^ table[0][crc & 0xFF]);
        }
    memset(crc_extra, 0xFF, sizeof crc_extra);
    for (size_t i = 0; i < LENGTH(KNOWN); i++)
        if (KNOWN[i].id < IDS) crc_extra[KNOWN[i].id] = KNOWN[i].crc_extra;
}

static uint16_t checksum(const uint8_t *at, size_t count, uint8_t extra) {
    uint16_t crc = 0xFFFF;
    for (; count >= 8; count -= 8, at += 8)
        crc = table[7][at[0] ^ (crc & 0xFF)] ^ table[6][at[1] ^ crc >> 8] ^ table[5][at[2]] ^ table[4][at[3]]
            ^ table[3][at[4]] ^ table[2][at[5]] ^ table[1][at[6]] ^ table[0][at[7]];
    for (; count; count--, at++) crc = (uint16_t)(crc >> 8 ^ table[0][(crc ^ *at) & 0xFF]);
    return (uint16_t)(crc >> 8 ^ table[0][(crc ^ extra) & 0xFF]);
}

/* The length of the record at `at`, whose message is counted; 0 where there is none. */
static size_t record_at(const uint8_t *at, size_t left) {
    const uint8_t *frame = at + STAMP;
    size_t header, payload, signature = 0;
    uint32_t id;
    if (left < STAMP + 8) return 0;
    payload = frame[1];
    if (frame[0] == 0xFD && left >= STAMP + 12) {
        header = 10;
        id = (uint32_t)(frame[7] | frame[8] << 8 | frame[9] << 16);
        if (frame[2] & 1) signature = SIGNATURE;
    } else if (frame[0] == 0xFE) {
        header = 6;
        id = frame[5];
    } else return 0;
    if (left < STAMP + header + payload + CRC + signature || id >= IDS || crc_extra[id] < 0) return 0;
    const uint8_t *crc = frame + header + payload;
    if (checksum(frame + 1, header - 1 + payload, (uint8_t)crc_extra[id]) != (crc[0] | crc[1] << 8)) return 0;
    counts[id]++;
    return STAMP + header + payload + CRC + signature;
}

int main(int argc, char **argv) {
    size_t held = 0, got;
    FILE *file = argc == 2 ? fopen(argv[1], "rb") : NULL;
    if (!file) {
        fprintf(stderr, "walker: one recording, please\n");
        return 2;
    }
    setvbuf(file, NULL, _IONBF, 0);
    make_tables();
    do {
        got = fread(buffer + held, 1, PIECE, file);
        held += got;
        size_t at = 0;
        while (held - at >= (got ? LONGEST : STAMP + 8)) {
            size_t length = record_at(buffer + at, held - at);
            at += length ? length : 1;
        }
        held -= at;
        memmove(buffer, buffer + at, held);
    } while (got);
    fclose(file);
    for (size_t i = 0; i < LENGTH(COUNTED); i++)
        printf("%s=%llu%c", COUNTED[i].name, (unsigned long long)counts[COUNTED[i].id], i + 1 < LENGTH(COUNTED) ? ' ' : '\n');
    return 0;
}
