/* Random numbers, draw for draw those of numpy's Generator(PCG64(SeedSequence(seed))).
 *
 * PCG64 is PCG XSL RR 128/64 [O'Neill 2014]; the mixing of seeds is that of numpy's SeedSequence, after O'Neill's
 * seed_seq; whole numbers are drawn by multiplication and rejection [Lemire 2019].
 */
#include "draws.h"

#include <string.h>

__extension__ typedef unsigned __int128 wide;

const char *sp_library(void) { return SP_LIBRARY; }

static wide join(uint64_t high, uint64_t low) { return (wide)high << 64 | low; }

/* Seeds: whatever is mixed in afterwards moves the pool on from where it is, so a pool and the constant of the next
 * step are all that a spawned sequence needs of its parents. */
#define POOL 4

static uint32_t stir(uint32_t value, uint32_t *hash, uint32_t factor)
{
    value ^= *hash;
    *hash *= factor;
    value *= *hash;
    return value ^ value >> 16;
}

static uint32_t blend(uint32_t x, uint32_t y)
{
    uint32_t z = 0xca01f9ddu * x - 0x4973f715u * y;
    return z ^ z >> 16;
}

static uint32_t absorb(uint32_t word, uint32_t *hash) { return stir(word, hash, 0x931e8875u); }

static void absorb_word(sp_generator *g, uint32_t word)
{
    for (int i = 0; i < POOL; i++) g->pool[i] = blend(g->pool[i], absorb(word, &g->hash));
}

/* The stream that belongs to the pool: eight words of it make PCG64's first state and its increment. */
static void start(sp_generator *g)
{
    uint32_t hash = 0x8b51f9ddu;
    uint64_t word[4];
    for (int i = 0; i < 4; i++) {
        uint64_t low = stir(g->pool[2 * i % POOL], &hash, 0x58f38dedu);
        word[i] = (uint64_t)stir(g->pool[(2 * i + 1) % POOL], &hash, 0x58f38dedu) << 32 | low;
    }
    wide increment = join(word[2], word[3]) << 1 | 1, state = increment + join(word[0], word[1]);
    g->increment_high = (uint64_t)(increment >> 64);
    g->increment_low = (uint64_t)increment;
    g->state_high = (uint64_t)(state >> 64);
    g->state_low = (uint64_t)state;
    g->has_half = g->half = 0;
    g->spawned = 0;
    sp_next64(g);
}

void sp_seed(const uint32_t *words, int32_t count, sp_generator *g)
{
    memset(g, 0, sizeof *g);
    g->hash = 0x43b0d7e5u;
    for (int i = 0; i < POOL; i++) g->pool[i] = absorb(i < count ? words[i] : 0, &g->hash);
    for (int i = 0; i < POOL; i++)
        for (int k = 0; k < POOL; k++)
            if (k != i) g->pool[k] = blend(g->pool[k], absorb(g->pool[i], &g->hash));
    for (int i = POOL; i < count; i++) absorb_word(g, words[i]);
    start(g);
}

/* Missing words of a seed count as zeros, and a spawn key goes in after them: as numpy pads a seed that has a key. */
void sp_spawn(sp_generator *parent, sp_generator *child)
{
    *child = *parent;
    absorb_word(child, parent->spawned++);
    start(child);
}

uint64_t sp_next64(sp_generator *g)
{
    wide state = join(g->state_high, g->state_low) * join(2549297995355413924u, 4865540595714422341u)
                 + join(g->increment_high, g->increment_low);
    g->state_high = (uint64_t)(state >> 64);
    g->state_low = (uint64_t)state;
    uint64_t folded = g->state_high ^ g->state_low;
    unsigned turn = (unsigned)(g->state_high >> 58);
    return folded >> turn | folded << (-turn & 63);
}

/* The lower half of a draw first; the upper one waits, however many other draws are between. */
uint32_t sp_next32(sp_generator *g)
{
    if (g->has_half) {
        g->has_half = 0;
        return g->half;
    }
    uint64_t both = sp_next64(g);
    g->has_half = 1;
    g->half = (uint32_t)(both >> 32);
    return (uint32_t)both;
}

double sp_random(sp_generator *g) { return (double)(sp_next64(g) >> 11) * 0x1p-53; }

double sp_uniform(sp_generator *g, double low, double high) { return low + (high - low) * sp_random(g); }

/* Ranges of up to 2^32 take halves of draws, wider ones whole draws, a single number none. */
int64_t sp_integer(sp_generator *g, int64_t low, int64_t high)
{
    uint64_t most = (uint64_t)high - (uint64_t)low - 1, drawn;
    if (most == 0) return low;
    if (most == UINT32_MAX) {
        drawn = sp_next32(g);
    } else if (most < UINT32_MAX) {
        uint32_t count = (uint32_t)most + 1, least = (UINT32_MAX - (uint32_t)most) % count;
        uint64_t product;
        do product = (uint64_t)sp_next32(g) * count;
        while ((uint32_t)product < least);
        drawn = product >> 32;
    } else if (most == UINT64_MAX) {
        drawn = sp_next64(g);
    } else {
        uint64_t count = most + 1, least = (UINT64_MAX - most) % count;
        wide product;
        do product = (wide)sp_next64(g) * count;
        while ((uint64_t)product < least);
        drawn = (uint64_t)(product >> 64);
    }
    return (int64_t)((uint64_t)low + drawn);
}
