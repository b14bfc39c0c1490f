/* Random numbers, draw for draw those of numpy's Generator(PCG64(SeedSequence(seed))).
 *
 * The environments use numpy's random, uniform, standard_normal, integers and spawn. Numpy draws the entries of an
 * array one after another, the last index varying fastest. A distribution's parameters consume no draws. The order of
 * the draws determines what a seed produces; it is documented where the draws are made.
 */
#ifndef SPIDAR_DRAWS_H
#define SPIDAR_DRAWS_H

#include "spidar_engine_structs.h" /* generated */

/* Seed with a whole number, given as its 32-bit words, the lowest first. There is at least one: 0 is the word 0. */
void sp_seed(const uint32_t *words, int32_t count, sp_generator *generator);
/* spawn(1)[0]; `child` must not be `parent`. */
void sp_spawn(sp_generator *parent, sp_generator *child);

uint64_t sp_next64(sp_generator *generator);
uint32_t sp_next32(sp_generator *generator);
double sp_random(sp_generator *generator);                             /* in [0, 1) */
double sp_uniform(sp_generator *generator, double low, double high);   /* in [low, high) */
double sp_normal(sp_generator *generator);                             /* mean 0, standard deviation 1 */
int64_t sp_integer(sp_generator *generator, int64_t low, int64_t high); /* in [low, high), for low < high */

#endif
