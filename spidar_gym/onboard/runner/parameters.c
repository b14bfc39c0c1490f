/* Robot, gains and limits: those that were compiled, or those of a parameter file, which is read whole or refused. */
#include <stdlib.h>
#include <string.h>

#include "runner.h"
#include "spidar_fields.h"
#include "spidar_math.h"
#include "spidar_model.h"
#include "spidar_presets.h"

#define PREFIX (8 + SP_NAME) /* characters of a section's name */

#define FIELDS(section) SP_##section##_FIELDS, (int)(sizeof SP_##section##_FIELDS / sizeof(sp_field))
static const struct {
    const char *name;
    const sp_field *fields;
    int count;
    size_t at;
} SECTIONS[] = {
    {"robot", FIELDS(ROBOT), offsetof(sp_parameters, robot)},
    {"limits", FIELDS(LIMITS), offsetof(sp_parameters, limits)},
    {"estimator", FIELDS(ESTIMATOR), offsetof(sp_parameters, estimator)},
    {"manager", FIELDS(MANAGER), offsetof(sp_parameters, manager)},
};

/* The lines of a file between the first and the last. */
typedef struct {
    char *rest;     /* after the present line */
    char *words[SP_WORDS];
    int count, line; /* words of the present line, 0 at the end, −1 if too many; its number */
    char *reason;
    size_t size;
} reader;

/* Go to the next line with words. */
static void advance(reader *r)
{
    r->count = 0;
    while (r->count == 0 && *r->rest != 0) {
        char *line = r->rest;
        size_t length = strcspn(line, "\n");
        r->rest += length + (line[length] != 0);
        line[length] = 0;
        r->line++;
        r->count = length > SP_PARAMETERS_LINE ? -1 : sp_split(line, r->words);
    }
}

static int refuse(const reader *r, const char *valid)
{
    snprintf(r->reason, r->size, "parameters, line %d; valid: %s", r->line, valid);
    return 0;
}

/* Convert a word to a number of a field; returns 0 for another one. Python's reader accepts the same texts. */
static int number(const sp_field *f, const char *word, double *value)
{
    char *end;
    if (f->words != NULL) {
        int k = 0;
        while (k <= (int)f->most && strcmp(word, f->words[k]) != 0) k++;
        *value = k;
    } else {
        if (word[strspn(word, "+-.0123456789eE")] != 0) return 0;
        *value = strtod(word, &end);
        if (*end != 0 || (f->whole && *value != floor(*value))) return 0;
    }
    return *value >= f->least && *value <= f->most;
}

static int within(const sp_field *f, const char *base)
{
    for (int k = 0; k < f->count; k++) {
        double value = f->whole ? ((const int32_t *)(base + f->at))[k] : ((const double *)(base + f->at))[k];
        if (!(value >= f->least && value <= f->most)) return 0;
    }
    return 1;
}

/* Take the present line as a field of the section; returns 0 after its refusal. */
static int take_field(reader *r, const char *section, const sp_field *f, char *base)
{
    char name[PREFIX + 64], valid[256];
    double v[SP_WORDS];
    int fits = r->count == 2 + f->count;
    snprintf(name, sizeof name, "%s.%s", section, f->name);
    fits = fits && strcmp(r->words[0], name) == 0 && strcmp(r->words[1], f->unit) == 0;
    for (int k = 0; fits && k < f->count; k++) fits = number(f, r->words[2 + k], v + k);
    if (!fits) {
        int n = snprintf(valid, sizeof valid, "%s %s and ", name, f->unit);
        if (f->words == NULL)
            snprintf(valid + n, sizeof valid - (size_t)n, "%d numbers within %g … %g", (int)f->count, f->least, f->most);
        for (int k = 0; f->words != NULL && k <= (int)f->most && n < (int)sizeof valid; k++)
            n += snprintf(valid + n, sizeof valid - (size_t)n, "%s%s", k == 0 ? "one of " : ", ", f->words[k]);
        return refuse(r, valid);
    }
    for (int k = 0; k < f->count; k++) {
        if (f->whole) ((int32_t *)(base + f->at))[k] = (int32_t)v[k];
        else ((double *)(base + f->at))[k] = v[k];
    }
    advance(r);
    return 1;
}

static int take_section(reader *r, const char *section, const sp_field *fields, int count, void *base)
{
    for (int k = 0; k < count; k++)
        if (!take_field(r, section, &fields[k], base)) return 0;
    return 1;
}

const sp_controller_config *sp_find_flight(const sp_parameters *p, const char *name)
{
    for (int k = 0; k < p->flight_count; k++)
        if (strcmp(p->flights[k].name, name) == 0) return &p->flights[k].config;
    return NULL;
}

const sp_crawler_config *sp_find_crawl(const sp_parameters *p, const char *name)
{
    for (int k = 0; k < p->crawl_count; k++)
        if (strcmp(p->crawls[k].name, name) == 0) return &p->crawls[k].config;
    return NULL;
}

static void add_flight(sp_parameters *p, const char *name, const sp_controller_config *config)
{
    if (sp_find_flight(p, name) != NULL) return; /* the file's preset has precedence */
    snprintf(p->flights[p->flight_count].name, SP_NAME, "%s", name);
    p->flights[p->flight_count++].config = *config;
}

static void add_crawl(sp_parameters *p, const char *name, const sp_crawler_config *config)
{
    if (sp_find_crawl(p, name) != NULL) return;
    snprintf(p->crawls[p->crawl_count].name, SP_NAME, "%s", name);
    p->crawls[p->crawl_count++].config = *config;
}

/* Take the presets up to the end; returns 0 after a refusal. */
static int take_presets(reader *r, sp_parameters *p)
{
    static sp_controller_config flight;
    static sp_crawler_config crawl;
    while (r->count != 0) {
        char section[PREFIX], *name = section;
        int flies = r->count > 0 && strncmp(r->words[0], "flight.", 7) == 0;
        int crawls = r->count > 0 && strncmp(r->words[0], "crawl.", 6) == 0, front = flies ? 7 : 6;
        size_t length = flies || crawls ? strspn(r->words[0] + front, "abcdefghijklmnopqrstuvwxyz0123456789_") : 0;
        int fits = length > 0 && length < SP_NAME && r->words[0][front + (int)length] == '.';
        if (fits) {
            snprintf(section, sizeof section, "%.*s", front + (int)length, r->words[0]);
            name += front;
        }
        if (!fits || (flies ? p->flight_count : p->crawl_count) == SP_MOST_PRESETS ||
            (flies ? sp_find_flight(p, name) != NULL : sp_find_crawl(p, name) != NULL))
            return refuse(r, "the first field of a new flight or crawl preset, or the end");
        memset(&flight, 0, sizeof flight);
        memset(&crawl, 0, sizeof crawl);
        if (flies ? !take_section(r, section, FIELDS(FLIGHT), &flight) : !take_section(r, section, FIELDS(CRAWL), &crawl))
            return 0;
        if (flies) add_flight(p, name, &flight);
        else add_crawl(p, name, &crawl);
    }
    return 1;
}

static int are_digits(const char *word) { return strlen(word) == 64 && strspn(word, "0123456789abcdef") == 64; }

static double determinant(const double *a)
{
    return a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]);
}

/* Whether a matrix is symmetric and positive definite. */
static int is_inertia(const double *a)
{
    const double trace = a[0] + a[4] + a[8], least = SP_PARAMETERS_LEAST_MOMENT, off = SP_PARAMETERS_ROUNDING * trace;
    const int is_even = fabs(a[1] - a[3]) <= off && fabs(a[2] - a[6]) <= off && fabs(a[5] - a[7]) <= off;
    return trace > 0.0 && is_even && a[0] > least * trace && a[0] * a[4] - a[1] * a[3] > least * trace * trace &&
           determinant(a) > least * trace * trace * trace;
}

static int is_rotation(const double *R)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (!(fabs(sp_row(R + 3 * i, R + 3 * j, 3) - (i == j)) <= SP_PARAMETERS_ROUNDING)) return 0;
    return determinant(R) > 0.0;
}

const char *sp_refuse_robot(const sp_robot *robot)
{
    double mass = 0.0;
    for (size_t k = 0; k < sizeof SP_ROBOT_FIELDS / sizeof *SP_ROBOT_FIELDS; k++)
        if (!within(&SP_ROBOT_FIELDS[k], (const char *)robot)) return "numbers within their ranges";
    for (int k = 0; k < SP_BODIES; k++) {
        const sp_body *body = &robot->tree[k];
        if (body->parent != SP_ROBOT.tree[k].parent || body->joint != SP_ROBOT.tree[k].joint)
            return "bodies and joints in the order of this version";
        if (!is_inertia(body->inertia)) return "a symmetric, positive definite inertia of every body";
        if (!is_rotation(body->rotation)) return "attitudes of joints that are rotations";
        if (k > 0 && !(fabs(sp_row(body->axis, body->axis, 3) - 1.0) <= SP_PARAMETERS_ROUNDING))
            return "axes of joints of length 1";
        mass += body->mass;
    }
    if (memcmp(robot->joint_body, SP_ROBOT.joint_body, sizeof robot->joint_body) != 0 ||
        memcmp(robot->link_body, SP_ROBOT.link_body, sizeof robot->link_body) != 0 ||
        memcmp(robot->rotor_body, SP_ROBOT.rotor_body, sizeof robot->rotor_body) != 0)
        return "bodies and joints in the order of this version";
    const double weight = mass * robot->gravity, off = SP_PARAMETERS_ROUNDING * weight;
    if (!(fabs(weight - robot->weight) <= off && fabs(weight - SP_ROTORS * robot->hover_thrust) <= off))
        return "a weight, and a thrust in a hover, of the bodies' masses";
    return weight < SP_ROTORS * robot->max_thrust ? NULL : "a weight below the thrust of its rotors";
}

int sp_is_own_robot(const sp_robot *robot) { return memcmp(robot, &SP_ROBOT, sizeof *robot) == 0; }

/* Add the compiled presets that a file does not have. */
static void add_compiled(sp_parameters *p)
{
#define ADD_FLIGHT(name, config) add_flight(p, #name, &config);
#define ADD_CRAWL(name, config) add_crawl(p, #name, &config);
    SP_CONTROLLER_PRESETS(ADD_FLIGHT)
    SP_CRAWLER_PRESETS(ADD_CRAWL)
}

void sp_compiled_parameters(sp_parameters *p)
{
    memset(p, 0, sizeof *p);
    snprintf(p->model, sizeof p->model, "%s", SP_MODEL_SHA256);
    snprintf(p->sha256, sizeof p->sha256, "%s", SP_PARAMETERS_SHA256);
    p->robot = SP_ROBOT;
    p->limits = SP_LIMITS;
    p->estimator = SP_ESTIMATOR;
    p->manager = SP_MANAGER;
    memset(&p->manager.flight, 0, sizeof p->manager.flight);
    memset(&p->manager.crawl, 0, sizeof p->manager.crawl);
    add_compiled(p);
}

/* Check the first line and the last; returns what would have been valid, or NULL. `end`: begin of the last line. */
static const char *check_frame(char *text, size_t size, sp_parameters *p, size_t *end)
{
    static const char HEAD[] = SP_PARAMETERS_FORMAT " interface ";
    const size_t first = strcspn(text, "\n"), front = sizeof HEAD - 1;
    if (first == size || strncmp(text, HEAD, front) != 0)
        return "no parameters; valid: a file that `spidar parameters` wrote, with " SP_PARAMETERS_FORMAT " in line 1";
    if (first - front != strlen(SP_RUNNER_INTERFACE) || strncmp(text + front, SP_RUNNER_INTERFACE, first - front) != 0)
        return "the parameters are of another interface; valid: " SP_RUNNER_INTERFACE ", that of this runner";
    for (*end = size - 1; *end > 0 && text[*end - 1] != '\n'; --*end) {}
    char *last = text + *end;
    if (size - *end != 72 || strncmp(last, "sha256 ", 7) != 0 || text[size - 1] != '\n')
        return "the parameters are cut; valid: a whole file, with its sha256 in the last line";
    text[size - 1] = 0;
    sp_sha256(text, *end, p->sha256);
    if (!are_digits(last + 7)) return "the parameters are cut; valid: a whole file, with its sha256 in the last line";
    return strcmp(last + 7, p->sha256) == 0 ? NULL
                                            : "the parameters were edited; valid: a file as `spidar parameters` wrote it";
}

int sp_read_parameters(char *text, sp_parameters *p, char *reason, size_t size)
{
    reader r = {.rest = text, .reason = reason, .size = size};
    size_t end = 0;
    memset(p, 0, sizeof *p);
    const char *why = check_frame(text, strlen(text), p, &end);
    if (why != NULL) {
        snprintf(reason, size, "%s", why);
        return 0;
    }
    text[end] = 0;
    r.rest += strcspn(text, "\n") + 1;
    r.line = 1;
    advance(&r);
    if (r.count != 3 || strcmp(r.words[0], SP_PARAMETERS_MODEL) != 0 || strcmp(r.words[1], "sha256") != 0 ||
        !are_digits(r.words[2]))
        return refuse(&r, SP_PARAMETERS_MODEL " sha256 and 64 digits");
    snprintf(p->model, sizeof p->model, "%s", r.words[2]);
    advance(&r);
    p->robot = SP_ROBOT; /* its structure; the other numbers are overwritten */
    for (size_t k = 0; k < sizeof SECTIONS / sizeof *SECTIONS; k++)
        if (!take_section(&r, SECTIONS[k].name, SECTIONS[k].fields, SECTIONS[k].count, (char *)p + SECTIONS[k].at)) return 0;
    if (!take_presets(&r, p)) return 0;
    if ((why = sp_refuse_robot(&p->robot)) != NULL) {
        snprintf(reason, size, "the parameters describe no possible robot; valid: %s", why);
        return 0;
    }
    add_compiled(p);
    return 1;
}

int sp_load_parameters(const char *path, sp_parameters *p)
{
    char reason[384];
    if (path == NULL) {
        sp_compiled_parameters(p);
        return 0;
    }
    char *text = sp_read_text(path, SP_PARAMETERS_BYTES);
    if (text == NULL) return sp_reject(path, ": no parameters; valid: a text file of at most 1 MiB that `spidar parameters` wrote");
    int whole = sp_read_parameters(text, p, reason, sizeof reason);
    free(text);
    return whole ? 0 : sp_reject("", reason);
}
