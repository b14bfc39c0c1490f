/* Random numbers, draw for draw those of numpy's Generator(PCG64(SeedSequence(seed))).
 *
 * PCG64 is PCG XSL RR 128/64 [ONeill2014], seeds are mixed as in ONeill's seed_seq, whole numbers drawn by a product
 * [Lemire2019], normal ones from a ziggurat [Marsaglia2000].
 */
#include "draws.h"
#include "spidar_math.h"
#include "spidar_ziggurat.h" /* generated */

__extension__ typedef unsigned __int128 wide;

static wide join(uint64_t high, uint64_t low) { return (wide)high << 64 | low; }

static uint64_t next64(sp_generator *g)
{
    wide state = join(g->state_high, g->state_low) * join(2549297995355413924u, 4865540595714422341u)
                 + join(g->increment_high, g->increment_low);
    g->state_high = (uint64_t)(state >> 64);
    g->state_low = (uint64_t)state;
    uint64_t folded = g->state_high ^ g->state_low;
    unsigned turn = (unsigned)(g->state_high >> 58);
    return folded >> turn | folded << (-turn & 63);
}

/* Return the lower half of a 64-bit draw; the upper half is kept for the next call, across draws of other kinds. */
static uint32_t next32(sp_generator *g)
{
    if (g->has_half) {
        g->has_half = 0;
        return g->half;
    }
    uint64_t both = next64(g);
    g->has_half = 1;
    g->half = (uint32_t)(both >> 32);
    return (uint32_t)both;
}

static double next_double(sp_generator *g) { return (double)(int64_t)(next64(g) >> 11) * 0x1p-53; }

uint64_t sp_next64(sp_generator *g) { return next64(g); }
uint32_t sp_next32(sp_generator *g) { return next32(g); }
double sp_random(sp_generator *g) { return next_double(g); }
double sp_uniform(sp_generator *g, double low, double high) { return low + (high - low) * next_double(g); }

/* Sample the tail beyond the edge by Marsaglia's method; its sign is a bit of `place`. */
static double tail(sp_generator *g, uint64_t place)
{
    for (;;) {
        double x = -(1.0 / SP_ZIGGURAT_EDGE) * log1p(-next_double(g)), y = -log1p(-next_double(g));
        if (y + y > x * x) return place >> 8 & 1 ? -(SP_ZIGGURAT_EDGE + x) : SP_ZIGGURAT_EDGE + x;
    }
}

/* One draw yields the layer, the sign and the place on the layer's width. Most places are under the curve for sure. */
double sp_normal(sp_generator *g)
{
    for (;;) {
        uint64_t drawn = next64(g), layer = drawn & 255, place = drawn >> 9 & 0xfffffffffffffu;
        double x = (double)(int64_t)place * SP_ZIGGURAT_DISTANCE[layer];
        if (drawn >> 8 & 1) x = -x;
        if (place < SP_ZIGGURAT_INSIDE[layer]) return x;
        if (layer == 0) return tail(g, place);
        double least = SP_ZIGGURAT_DENSITY[layer], most = SP_ZIGGURAT_DENSITY[layer - 1];
        if ((most - least) * next_double(g) + least < exp(-0.5 * x * x)) return x;
    }
}

/* Ranges of up to 2^32 numbers consume half draws, wider ranges whole draws, a single number none. */
int64_t sp_integer(sp_generator *g, int64_t low, int64_t high)
{
    uint64_t most = (uint64_t)high - (uint64_t)low - 1, drawn;
    if (most == 0) return low;
    if (most == UINT32_MAX) {
        drawn = next32(g);
    } else if (most < UINT32_MAX) {
        uint32_t count = (uint32_t)most + 1, least = (UINT32_MAX - (uint32_t)most) % count;
        uint64_t product;
        do product = (uint64_t)next32(g) * count;
        while ((uint32_t)product < least);
        drawn = product >> 32;
    } else if (most == UINT64_MAX) {
        drawn = next64(g);
    } else {
        uint64_t count = most + 1, least = (UINT64_MAX - most) % count;
        wide product;
        do product = (wide)next64(g) * count;
        while ((uint64_t)product < least);
        drawn = (uint64_t)(product >> 64);
    }
    return (int64_t)((uint64_t)low + drawn);
}

static uint32_t stir(uint32_t word, uint32_t *hash, uint32_t factor)
{
    word ^= *hash;
    *hash *= factor;
    word *= *hash;
    return word ^ word >> 16;
}

/* Mix a word into one of the pool's words. */
static void blend(sp_generator *g, int k, uint32_t word)
{
    uint32_t mixed = SP_SEED_LEFT * g->pool[k] - SP_SEED_RIGHT * stir(word, &g->hash, SP_SEED_FACTOR);
    g->pool[k] = mixed ^ mixed >> 16;
}

static void absorb(sp_generator *g, uint32_t word)
{
    for (int k = 0; k < SP_SEED_POOL; k++) blend(g, k, word);
}

/* Initialise PCG64 from the pool with eight words of 32 bits, the lower word of each pair first. */
static void begin(sp_generator *g)
{
    uint32_t hash = SP_STATE_START;
    uint64_t words[4];
    for (int i = 0; i < 4; i++) {
        uint32_t low = stir(g->pool[2 * i % SP_SEED_POOL], &hash, SP_STATE_FACTOR);
        words[i] = (uint64_t)stir(g->pool[(2 * i + 1) % SP_SEED_POOL], &hash, SP_STATE_FACTOR) << 32 | low;
    }
    wide increment = join(words[2], words[3]) << 1 | 1, state = increment + join(words[0], words[1]);
    g->increment_high = (uint64_t)(increment >> 64);
    g->increment_low = (uint64_t)increment;
    g->state_high = (uint64_t)(state >> 64);
    g->state_low = (uint64_t)state;
    g->has_half = g->half = g->spawned = 0;
    next64(g);
}

void sp_seed(const uint32_t *words, int32_t count, sp_generator *g)
{
    g->hash = SP_SEED_START;
    for (int k = 0; k < SP_SEED_POOL; k++) g->pool[k] = stir(k < count ? words[k] : 0, &g->hash, SP_SEED_FACTOR);
    for (int i = 0; i < SP_SEED_POOL; i++)
        for (int k = 0; k < SP_SEED_POOL; k++)
            if (k != i) blend(g, k, g->pool[i]);
    for (int i = SP_SEED_POOL; i < count; i++) absorb(g, words[i]);
    begin(g);
}

/* numpy mixes a child's seed from the beginning: the seed, zeros up to the pool's size, and the spawn key, which is the
 * parent's key followed by the child's number. The last word updates the pool that the earlier words have produced, so
 * the parent's pool is a sufficient starting point. */
void sp_spawn(sp_generator *parent, sp_generator *child)
{
    *child = *parent;
    absorb(child, parent->spawned++);
    begin(child);
}
