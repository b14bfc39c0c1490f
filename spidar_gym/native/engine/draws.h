/* Random numbers, draw for draw those of numpy's Generator(PCG64(SeedSequence(seed))).
 *
 * Of numpy's draws the environments use random, uniform, standard_normal, integers and spawn; those that give an array
 * are its entries drawn one after another, the last index first, and a distribution's parameters are no draws. The
 * order of the draws is part of what a seed means; it stands where they are made.
 */
#ifndef SPIDAR_DRAWS_H
#define SPIDAR_DRAWS_H

#include "spidar_engine_structs.h" /* generated */

/* Of a whole number, given as its 32-bit words, the lowest first: one word at least, so that of 0 is 0. */
void sp_seed(const uint32_t *words, int32_t count, sp_generator *generator);
/* spawn(1)[0]; the child is another struct than its parent. */
void sp_spawn(sp_generator *parent, sp_generator *child);

uint64_t sp_next64(sp_generator *generator);
uint32_t sp_next32(sp_generator *generator);
double sp_random(sp_generator *generator);                             /* in [0, 1) */
double sp_uniform(sp_generator *generator, double low, double high);   /* in [low, high) */
double sp_normal(sp_generator *generator);                             /* of mean 0 and standard deviation 1 */
int64_t sp_integer(sp_generator *generator, int64_t low, int64_t high); /* in [low, high), for low < high */

#endif
