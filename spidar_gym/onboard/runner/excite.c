/* The forms of a mission, and excitations: sines, chirps and square waves on the targets of joints or the thrusts. */
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

#define RAMP 1.0  /* over which a sine or a chirp begins and ends, at most a quarter of its time [s] */
#define MAX_SPEED 1.62 /* of a joint without load [rad/s] [ROBOTIS] */

static const char *const EXCITED[] = {"joint", "thrust"}, *const SHAPES[] = {"sine", "chirp", "square"};

static int index_of(const char *word, const char *const *words, int count)
{
    for (int k = 0; k < count; k++)
        if (strcmp(word, words[k]) == 0) return k;
    return -1;
}

const char *sp_read_excitation(sp_mission *m, char **words, int count)
{
    static const char VALID[] = "excite joint or thrust, NUMBER, sine or square, BEGIN END [s] AMPLITUDE [rad, N] "
                                "FREQUENCY [Hz]; or chirp and two frequencies";
    double which, v[5];
    if (count < 8) return VALID;
    int excited = index_of(words[1], EXCITED, 2), shape = index_of(words[3], SHAPES, 3);
    int n = shape == SP_SHAPE_CHIRP ? 5 : 4;
    if (excited < 0 || shape < 0 || !sp_numbers(words + 1, 2, 1, &which) || !sp_numbers(words + 3, count - 3, n, v)) return VALID;
    if (m->kind != SP_MISSION_FLIGHT && !(m->kind == SP_MISSION_BENCH && excited == SP_EXCITED_JOINT))
        return "excite joint for a flight or a bench test, excite thrust for a flight";
    int most = excited == SP_EXCITED_JOINT ? SP_JOINTS : SP_ROTORS;
    if (!(which >= 1.0 && which <= most && which == floor(which))) return "joints 1 … 16, modules 1 … 8";
    if (m->excitation_count == SP_MAX_EXCITATIONS) return "at most 64 excitations";
    if (!(v[0] >= 0.0 && v[0] < v[1])) return "an excitation that ends after its begin";
    if (!(fabs(v[2]) <= SP_MOST_EXCITATION[excited])) return "an amplitude within ± 0.3 rad or ± 10 N";
    double highest = n == 5 ? sp_max(v[3], v[4]) : v[3], least = n == 5 ? sp_min(v[3], v[4]) : v[3];
    if (!(least > 0.0 && highest <= SP_FASTEST_EXCITATION)) return "frequencies above 0, at most 10 Hz";
    if (excited == SP_EXCITED_JOINT && shape != SP_SHAPE_SQUARE && fabs(v[2]) * 2.0 * SP_PI * highest > MAX_SPEED)
        return "a joint's amplitude times 2 pi times its frequency within 1.62 rad/s, what the servos can do";
    sp_excitation *e = &m->excitations[m->excitation_count++];
    *e = (sp_excitation){.excited = excited, .index = (int32_t)which - 1, .shape = shape, .start = v[0], .end = v[1],
                         .amplitude = v[2], .frequency = v[3], .last_frequency = n == 5 ? v[4] : v[3]};
    return NULL;
}

/* Value of an excitation at a time. */
static double value_at(const sp_excitation *e, double t)
{
    double since = t - e->start, span = e->end - e->start, ramp = sp_min(RAMP, 0.25 * span);
    if (!(since >= 0.0 && since < span)) return 0.0;
    double turns = since * (e->frequency + 0.5 * (e->last_frequency - e->frequency) * since / span);
    if (e->shape == SP_SHAPE_SQUARE) return turns - floor(turns) < 0.5 ? e->amplitude : -e->amplitude;
    return e->amplitude * sp_min(1.0, sp_min(since, span - since) / ramp) * sin(2.0 * SP_PI * turns);
}

void sp_excite(const sp_mission *m, sp_excited excited, double t, double *values)
{
    for (int k = 0; k < m->excitation_count; k++)
        if (m->excitations[k].excited == (int32_t)excited)
            values[m->excitations[k].index] += value_at(&m->excitations[k], t + 1e-9);
}

int sp_is_over(const sp_loop *l) { return l->aborted || l->ending != SP_FINE; }

int sp_is_strained(const sp_loop *l)
{
    double most = l->mission.limits.deviation;
    for (int j = 0; j < SP_JOINTS; j++)
        if (most > 0.0 && !(fabs(l->sense.state.joint_position[j] - l->command.joint_position[j]) <= most)) return 1;
    return 0;
}

void sp_next_form(sp_loop *l, double t)
{
    const sp_mission *m = &l->mission;
    const double limit = m->robot.joint_limit;
    for (int k = 0; k < m->form_count && !sp_is_over(l); k++)
        if (t >= m->forms[k].start - 1e-9) sp_copy(l->form, m->forms[k].joint_target, SP_JOINTS);
    sp_copy(l->reference.joint_target, l->form, SP_JOINTS);
    if (!sp_is_over(l)) sp_excite(m, SP_EXCITED_JOINT, t, l->reference.joint_target);
    for (int j = 0; j < SP_JOINTS; j++)
        l->reference.joint_target[j] = sp_clip(l->reference.joint_target[j], -limit, limit);
    l->finished = l->finished || (m->end > 0.0 && t >= m->end);
}
