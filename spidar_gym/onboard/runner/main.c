/* The runner's command line: drive the robot, or check and time the core without a robot. */
#include <stdio.h>
#include <string.h>

#include "runner.h"

typedef struct {
    const char *log, *space, *out;
    int residual;
} options;

/* Read the options after the mission; returns 0 for an unknown option. */
static int read_options(int count, char **words, options *o)
{
    o->log = NULL;
    o->space = o->out = "/spidar";
    o->residual = 0;
    int named = 0;
    for (int k = 0; k < count; k++) {
        if (strcmp(words[k], "--residual") == 0) o->residual = 1;
        else if (k + 1 == count) return 0;
        else if (strcmp(words[k], "--log") == 0) o->log = words[++k];
        else if (strcmp(words[k], "--namespace") == 0) o->space = words[++k];
        else if (strcmp(words[k], "--out") == 0) o->out = words[++k], named = 1;
        else return 0;
    }
    if (!named) o->out = o->space;
    return 1;
}

static int run_link(const sp_parameters *p, int count, char **words)
{
    options o;
    if (count < 2) return -1;
    if (strcmp(words[1], "sim") == 0 && count >= 4 && read_options(count - 4, words + 4, &o))
        return sp_sim(p, words[2], words[3], o.log, o.residual);
    if (strcmp(words[1], "ros1") == 0 && count >= 3 && read_options(count - 3, words + 3, &o)) {
#ifdef SPIDAR_ROS1
        return sp_ros1(p, words[2], o.space, o.out, o.log, o.residual);
#else
        return sp_reject("", "compiled without ROS 1; valid: a build where roscpp is found, see README.md");
#endif
    }
    return -1;
}

/* Take `--parameters FILE` out of the words; returns the file, or NULL without. */
static const char *take_file(int *count, char **words)
{
    for (int k = 1; k + 1 < *count; k++)
        if (strcmp(words[k], "--parameters") == 0) {
            const char *file = words[k + 1];
            memmove(words + k, words + k + 2, (size_t)(*count - k - 2) * sizeof *words);
            *count -= 2;
            return file;
        }
    return NULL;
}

int main(int count, char **words)
{
    static sp_parameters p;
    const char *file = take_file(&count, words), *mode = count > 1 ? words[1] : "";
    if (count == 4 && strcmp(mode, "compare") == 0 && file == NULL) return sp_compare(words[2], words[3]);
    if (sp_load_parameters(file, &p) != 0) return 2;
    if (count == 4 && strcmp(mode, "replay") == 0) return sp_replay(&p, file != NULL, words[2], words[3]);
    if (count == 3 && strcmp(mode, "bench") == 0) return sp_bench(&p, words[2]);
    if (count == 2 && strcmp(mode, "about") == 0) {
        printf("interface %s\nmodel %s\nparameters %s\n", SP_RUNNER_INTERFACE, p.model, p.sha256);
        return 0;
    }
    int done = run_link(&p, count, words);
    if (done >= 0) return done;
    fprintf(stderr, "usage: runner replay IN OUT | compare OUT GOLDEN | bench IN | about\n"
                    "       runner sim HOST:PORT MISSION [--log FILE] [--residual]\n"
                    "       runner ros1 MISSION [--namespace /spidar] [--out /spidar_dry] [--log FILE] [--residual]\n"
                    "       each but compare also with --parameters FILE: robot, gains and limits of that file\n");
    return 2;
}
