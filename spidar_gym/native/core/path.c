/* Paths of the CoG and heading: quintics between knots, and functions that build them. The Python twin
 * `control/flight/path.py` documents the arguments. */
#include "spidar_core.h"
#include "spidar_math.h"

/* Pose, rate and acceleration at a time. */
void sp_path_at(const sp_knot *knots, int n, double time, double *pose, double *rate, double *acceleration)
{
    int first = n - 1;
    while (first >= 0 && knots[first].time > time) first--;
    sp_zero(rate, 4);
    sp_zero(acceleration, 4);
    if (first < 0 || first + 1 >= n) {
        sp_copy(pose, knots[first < 0 ? 0 : first].pose_w, 4);
        return;
    }
    const sp_knot *a = knots + first, *b = a + 1;
    double T = b->time - a->time, u = (time - a->time) / T;
    for (int i = 0; i < 4; i++) {
        double c0 = a->pose_w[i], c1 = T * a->rate_w[i], c2 = 0.5 * T * T * a->acceleration_w[i];
        double d = b->pose_w[i] - (c0 + c1 + c2), e = T * b->rate_w[i] - (c1 + 2.0 * c2);
        double f = T * T * b->acceleration_w[i] - 2.0 * c2;
        double c3 = 10.0 * d - 4.0 * e + 0.5 * f, c4 = -15.0 * d + 7.0 * e - f, c5 = 6.0 * d - 3.0 * e + 0.5 * f;
        pose[i] = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))));
        rate[i] = (c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))) / T;
        acceleration[i] = (2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))) / (T * T);
    }
}

/* Preview of the path at a time, for a policy's observation. */
void sp_preview_path(const sp_knot *knots, int n, double time, sp_preview *preview)
{
    double pose[4], rate[4], acceleration[4], then[4], more[4];
    sp_path_at(knots, n, time, pose, rate, acceleration);
    sp_copy(preview->velocity_w, rate, 3);
    sp_copy(preview->acceleration_w, acceleration, 3);
    for (int k = 0; k < SP_PATH_AHEAD; k++) {
        sp_path_at(knots, n, time + SP_PATH_AHEAD_STEP * (k + 1), then, more, more);
        for (int i = 0; i < 3; i++) preview->ahead_w[3 * k + i] = then[i] - pose[i];
        preview->turn[k] = then[3] - pose[3];
    }
}

/* Write the controller's reference at a time: on the path, torso level. */
void sp_follow_path(const sp_knot *knots, int n, double time, sp_reference *reference)
{
    double pose[4], rate[4], acceleration[4];
    sp_path_at(knots, n, time, pose, rate, acceleration);
    sp_copy(reference->position_w, pose, 3);
    sp_copy(reference->velocity_w, rate, 3);
    sp_copy(reference->acceleration_w, acceleration, 3);
    sp_zero(reference->quat_wb, 4);
    sp_zero(reference->omega_b, 3);
    sp_zero(reference->alpha_b, 3);
    reference->quat_wb[0] = cos(0.5 * pose[3]);
    reference->quat_wb[3] = sin(0.5 * pose[3]);
    reference->omega_b[2] = rate[3];
    reference->alpha_b[2] = acceleration[3];
}

/* Wrap an angle to −π … π. */
static double wrap(double angle) { return angle - SP_TWO_PI * floor((angle + SP_PI) / SP_TWO_PI); }

/* Appends knots: all are counted, the first `room` are written. */
typedef struct {
    sp_knot *knots;
    int room, count;
} writer;

static sp_knot *add(writer *w, double time, const double *position, double heading)
{
    if (w->count++ >= w->room) return NULL;
    sp_knot *knot = w->knots + w->count - 1;
    memset(knot, 0, sizeof *knot);
    knot->time = time;
    sp_copy(knot->pose_w, position, 3);
    knot->pose_w[3] = heading;
    return knot;
}

static void at_rate(sp_knot *knot, const double *way, double share)
{
    if (knot == NULL) return;
    for (int i = 0; i < 3; i++) knot->rate_w[i] = share * way[i];
}

/* Begin a path of straight legs. */
void sp_begin_legs(const double *point, double speed, int along, double yaw, double begin, sp_knot *knots, int room,
                   sp_legs *legs)
{
    writer w = {knots, room, 0};
    sp_copy(legs->point, point, 3);
    legs->speed = speed;
    legs->along = along;
    legs->heading = yaw;
    legs->seconds = begin;
    add(&w, begin, point, yaw);
    legs->count = w.count;
}

/* Append a straight leg to another point, with rest there. */
void sp_leg_to(const double *point, sp_knot *knots, int room, sp_legs *legs)
{
    writer w = {knots, room, legs->count};
    const double *from = legs->point;
    double way[3] = {point[0] - from[0], point[1] - from[1], point[2] - from[2]}, place[3], length = sp_norm(way);
    if (legs->along && (way[0] != 0.0 || way[1] != 0.0)) {
        double turn = wrap(atan2(way[1], way[0]) - legs->heading);
        legs->heading += turn;
        if (turn != 0.0) {
            legs->seconds += sp_max(SP_PATH_REST, SP_PATH_PEAK * fabs(turn) / SP_PATH_TURN_RATE);
            add(&w, legs->seconds, from, legs->heading);
        }
    }
    double most = sqrt(length * SP_PATH_EASE), fast = sp_min(legs->speed, most);
    double ease = fast / SP_PATH_EASE, share = 0.5 * (fast / most) * (fast / most);
    legs->seconds += ease;
    for (int i = 0; i < 3; i++) place[i] = from[i] + share * way[i];
    at_rate(add(&w, legs->seconds, place, legs->heading), way, fast / length);
    if (share < 0.5 - 1e-9) {
        legs->seconds += (1.0 - 2.0 * share) * length / fast;
        for (int i = 0; i < 3; i++) place[i] = point[i] - share * way[i];
        at_rate(add(&w, legs->seconds, place, legs->heading), way, fast / length);
    }
    legs->seconds += ease;
    add(&w, legs->seconds, point, legs->heading);
    legs->seconds += SP_PATH_REST;
    add(&w, legs->seconds, point, legs->heading);
    sp_copy(legs->point, point, 3);
    legs->count = w.count;
}

/* Smooth step from 0 to 1: the quintic from rest to rest. */
double sp_ease(double u)
{
    u = sp_clip(u, 0.0, 1.0);
    return u * u * u * (10.0 - u * (15.0 - 6.0 * u));
}

/* Time that a coordinate takes from motion to rest; `fades`: whether its motion decays first. */
static double time_from_motion(double d, double v, double a, double pace, double brake, double seconds, int *fades)
{
    double drifts = HUGE_VAL, swings = HUGE_VAL, ahead = SP_PATH_DETOUR + SP_PATH_RUN_AHEAD * fabs(d);
    double least = sp_max(sp_max(SP_PATH_LEAST_SECONDS, SP_PATH_PEAK * fabs(d) / pace),
                          sp_max(2.0 * fabs(v) / brake, sqrt(3.0 * fabs(d) / brake)));
    if (v != 0.0) drifts = (d * v < 0.0 ? SP_PATH_DETOUR : ahead) / (SP_PATH_DRIFT * fabs(v));
    if (a != 0.0) swings = sqrt((d * a < 0.0 ? SP_PATH_DETOUR : ahead) / (SP_PATH_SWING * fabs(a)));
    double takes = sp_min(seconds, sp_max(least, sp_min(drifts, swings)));
    *fades = takes > swings || (d * v < 0.0 && takes > drifts);
    return takes;
}

/* Write one coordinate's path as entry 0 of two knots, or three if it fades; returns the number of knots. */
static int part_from_motion(double p, double v, double a, double end, double speed, double takes, double fade,
                            sp_knot *part)
{
    int last = fade > 0.0 ? 2 : 1;
    memset(part, 0, 3 * sizeof *part);
    part[0].pose_w[0] = p;
    part[0].rate_w[0] = v;
    part[0].acceleration_w[0] = a;
    if (last == 2) {
        double after = v * (end - p) < 0.0 ? 0.0 : sp_clip(v, -speed, speed), middle = p + 0.5 * fade * (v + after);
        part[1].time = fade;
        part[1].pose_w[0] = middle;
        part[1].rate_w[0] = after;
    }
    part[last].time = fade + takes;
    part[last].pose_w[0] = end;
    return last + 1;
}

/* Plan a path from the motion `begin` to rest at a pose; writes up to six knots and returns their number. */
int sp_path_from_motion(const sp_knot *begin, const double *end, double speed, sp_knot *knots)
{
    const double *p = begin->pose_w, *v = begin->rate_w, *a = begin->acceleration_w;
    sp_knot parts[4][3];
    int counts[4], fades[4], count = 1;
    double way[4], takes[4], fade = SP_PATH_FADE;
    for (int k = 0; k < 4; k++) way[k] = end[k] - p[k];
    double length = sp_norm(way), turn = fabs(way[3]);
    double seconds = sp_max(sp_max(SP_PATH_PEAK * length / speed, sqrt(3.0 * length / SP_PATH_EASE)),
                            sp_max(2.0 * sp_norm(v) / SP_PATH_EASE, SP_PATH_LEAST_SECONDS));
    seconds = sp_max(seconds, sp_max(SP_PATH_PEAK * turn / SP_PATH_TURN_RATE, sqrt(3.0 * turn / SP_PATH_TURN_RATE)));
    for (int k = 0; k < 4; k++) {
        double brake = k == 3 ? SP_PATH_TURN_RATE : SP_PATH_EASE;
        takes[k] = time_from_motion(way[k], v[k], a[k], k == 3 ? SP_PATH_TURN_RATE : speed, brake, seconds, &fades[k]);
        if (fades[k] && way[k] * v[k] < 0.0) fade = sp_max(fade, 2.0 * fabs(v[k]) / brake);
    }
    for (int k = 0; k < 4; k++)
        counts[k] = part_from_motion(p[k], v[k], a[k], end[k], speed, takes[k], fades[k] ? fade : 0.0, parts[k]);
    knots[0] = *begin;
    knots[0].time = 0.0;
    for (;;) {
        double time = knots[count - 1].time, next = HUGE_VAL;
        for (int k = 0; k < 4; k++)
            for (int i = 1; i < counts[k]; i++)
                if (parts[k][i].time - time >= SP_PATH_TOGETHER) next = sp_min(next, parts[k][i].time);
        if (next == HUGE_VAL) return count;
        sp_knot *knot = &knots[count++];
        memset(knot, 0, sizeof *knot);
        knot->time = next;
        for (int k = 0; k < 4; k++) {
            double pose[4], rate[4], acceleration[4];
            sp_path_at(parts[k], counts[k], next, pose, rate, acceleration);
            knot->pose_w[k] = pose[0];
            knot->rate_w[k] = rate[0];
            knot->acceleration_w[k] = acceleration[0];
        }
    }
}

/* Speed along a lemniscate and its rate, t after the beginning. */
static double pace(double speed, double seconds, double t, double *change)
{
    double ease = speed / SP_PATH_EASE, u = sp_max(0.0, sp_min(sp_min(1.0, t / ease), (seconds - t) / ease));
    double sign = t < 0.5 * seconds ? 1.0 : -1.0;
    *change = sign * speed * 30.0 * u * u * (1.0 - u) * (1.0 - u) / ease;
    return speed * u * u * u * (10.0 - u * (15.0 - 6.0 * u));
}

static double slope(double half_width, double speed, double seconds, double s, double t)
{
    double sine = sin(s), change;
    return pace(speed, seconds, t, &change) * sqrt(1.0 + sine * sine) / half_width;
}

/* Bernoulli's lemniscate from its crossing; returns the number of knots, of which the first `room` are written. */
int sp_path_lemniscate(double half_width, double speed, double seconds, const double *position_w, double direction,
                       int along, double begin, sp_knot *knots, int room)
{
    writer w = {knots, room, 0};
    double a = half_width, turn = direction + 0.25 * SP_PI, c = cos(turn), n = sin(turn), s = -0.5 * SP_PI;
    int last = (int)ceil(seconds / SP_PATH_KNOT_TIME - 1e-9);
    for (int k = 0; k <= last; k++) {
        double time = k * SP_PATH_KNOT_TIME, dv;
        for (int i = 0; k > 0 && i < SP_PATH_SUBSTEPS; i++) {
            double h = SP_PATH_KNOT_TIME / SP_PATH_SUBSTEPS, t = time - SP_PATH_KNOT_TIME + i * h;
            double k1 = slope(a, speed, seconds, s, t);
            double k2 = slope(a, speed, seconds, s + 0.5 * h * k1, t + 0.5 * h);
            double k3 = slope(a, speed, seconds, s + 0.5 * h * k2, t + 0.5 * h);
            double k4 = slope(a, speed, seconds, s + h * k3, t + h);
            s += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        double v = pace(speed, seconds, time, &dv), sine = sin(s), cosine = cos(s), D = 1.0 + sine * sine;
        double root = sqrt(D), x = a * cosine / D, y = a * sine * cosine / D;
        double heading = turn + 3.0 * atan(sine) + 0.5 * SP_PI, bend = 3.0 * cosine / (a * root);
        double bend_rate = -3.0 * sine * (D + cosine * cosine) / (a * root * D) * (v * root / a);
        double tx = cos(heading), ty = sin(heading);
        double place[3] = {position_w[0] + c * x - n * y, position_w[1] + n * x + c * y, position_w[2]};
        sp_knot *knot = add(&w, begin + time, place, along ? heading : 0.0);
        if (knot == NULL) continue;
        knot->rate_w[0] = v * tx;
        knot->rate_w[1] = v * ty;
        knot->acceleration_w[0] = dv * tx - v * v * bend * ty;
        knot->acceleration_w[1] = dv * ty + v * v * bend * tx;
        if (!along) continue;
        knot->rate_w[3] = v * bend;
        knot->acceleration_w[3] = bend_rate * v + bend * dv;
    }
    return w.count;
}

/* Set rates and accelerations from parabolas through neighbouring knots, for coordinates `from` … `to` − 1. */
static void bend_through(sp_knot *knots, int n, int from, int to)
{
    for (int k = 1; k + 1 < n; k++) {
        double before = knots[k].time - knots[k - 1].time, after = knots[k + 1].time - knots[k].time;
        for (int i = from; i < to; i++) {
            double left = (knots[k].pose_w[i] - knots[k - 1].pose_w[i]) / before;
            double right = (knots[k + 1].pose_w[i] - knots[k].pose_w[i]) / after;
            knots[k].rate_w[i] = (after * left + before * right) / (before + after);
            knots[k].acceleration_w[i] = 2.0 * (right - left) / (before + after);
        }
    }
}

/* Direction in which a spline leaves its start or reaches its end. */
static double end_heading(const sp_knot *end, const sp_knot *next, double sign)
{
    double T = fabs(end->time - next->time), way[2];
    for (int i = 0; i < 2; i++)
        way[i] = 10.0 * sign * (next->pose_w[i] - end->pose_w[i]) - 4.0 * T * next->rate_w[i] +
                 0.5 * sign * T * T * next->acceleration_w[i];
    return atan2(way[1], way[0]);
}

/* Complete n knots, given their positions, to a smooth path from rest to rest. */
void sp_path_spline(sp_knot *knots, int n, double speed, int along, double yaw, double begin)
{
    double time = begin, heading = yaw;
    for (int k = 0; k < n; k++) {
        if (k > 0) {
            double way[3];
            for (int i = 0; i < 3; i++) way[i] = knots[k].pose_w[i] - knots[k - 1].pose_w[i];
            time += sp_norm(way) / speed * (k == 1 || k == n - 1 ? 2.0 : 1.0);
        }
        knots[k].time = time;
        knots[k].pose_w[3] = yaw;
        sp_zero(knots[k].rate_w, 4);
        sp_zero(knots[k].acceleration_w, 4);
    }
    bend_through(knots, n, 0, 3);
    for (int k = 0; along && k < n; k++) {
        double ahead = k == 0       ? end_heading(knots, knots + 1, 1.0)
                       : k == n - 1 ? end_heading(knots + k, knots + k - 1, -1.0)
                                    : atan2(knots[k].rate_w[1], knots[k].rate_w[0]);
        heading = k == 0 ? ahead : heading + wrap(ahead - heading);
        knots[k].pose_w[3] = heading;
    }
    bend_through(knots, n, 3, 4);
}
