/* The equations of TCI's compiled loops in plain C: computes the gains of the fields from a raw frame.
   cc -O3 -march=native -fno-trapping-math -fno-math-errno -shared -fPIC response.c -o response.so -lm */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define RHO 0.3

typedef struct {
    int64_t n, fields_n, repeats, stride, padded, straight, frames, since, turn, end, felt;
    const uint8_t *values; const int64_t *channels; const float *sensor, *offset;
    const double *gain, *area; float *memory; uint8_t *octets; uint16_t *words; int32_t *blocks, *active;
    double *force; double floor, touch;
    const int32_t *graph; int32_t *work; const double *taxels; const int32_t *faces; const double *box;
    const int32_t *cells; const double *T_TL, *T_TG, *limb, *posture;
    double *numbers, *vectors; int64_t *indices; double *places;
    const double *fields; double *gains;
} frame_t;

#define BLOCK 64
#define MIN(a, b) ((a) < (b) ? (a) : (b))
#define MAX(a, b) ((a) > (b) ? (a) : (b))

static float signal_of(uint8_t octet, uint8_t turn, const float *s) { return s[3] * ((float)(octet ^ turn) - s[2]); }

static void catch_up(const uint8_t *restrict last, uint8_t *restrict low, uint8_t *restrict high,
                     uint16_t *restrict sum, uint16_t times) {
    for (int i = 0; i < BLOCK; i++) {
        sum[i] += times * last[i];
        low[i] = MIN(low[i], last[i]);
        high[i] = MAX(high[i], last[i]);
    }
}

static void note(const uint8_t *restrict now, uint8_t *restrict last, uint8_t *restrict earlier, uint8_t *restrict low,
                 uint8_t *restrict high, uint8_t *restrict changes, uint16_t *restrict sum, uint16_t *restrict bends,
                 uint16_t bending, uint8_t changing) {
    for (int i = 0; i < BLOCK; i++) {
        uint16_t ends = now[i] + earlier[i], middle = 2 * last[i];
        bends[i] += (uint16_t)(MAX(ends, middle) - MIN(ends, middle)) & bending;
        changes[i] += (now[i] != last[i]) & changing;
        low[i] = MIN(low[i], now[i]);
        high[i] = MAX(high[i], now[i]);
        sum[i] += now[i];
        earlier[i] = last[i];
        last[i] = now[i];
    }
}

static void spill(frame_t *f) {
    int64_t n = f->n, w = f->padded, blocks = w / BLOCK;
    uint8_t *last = f->octets + w, *earlier = last + w, *low = earlier + w, *high = low + w, *changes = high + w;
    uint16_t *sum = f->words, *bends = sum + w;
    uint8_t turn = (uint8_t)f->turn;
    float *m = f->memory;
    for (int64_t b = 0; b < blocks; b++)
        if (f->blocks[b]) {
            int64_t o = b * BLOCK;
            catch_up(last + o, low + o, high + o, sum + o, (uint16_t)f->blocks[b]);
            f->blocks[b] = 0;
        }
    for (int64_t i = 0; i < n; i++) {
        float zero = f->offset[i];
        m[i] = signal_of(last[i], turn, f->sensor);
        m[n + i] = signal_of(earlier[i], turn, f->sensor);
        double total = turn ? 255.0 * f->since - sum[i] : sum[i];
        m[2 * n + i] += (float)(f->sensor[3] * (total - (double)f->since * f->sensor[2]));
        float up = fabsf(signal_of(high[i], turn, f->sensor) - zero), down = fabsf(signal_of(low[i], turn, f->sensor) - zero);
        m[3 * n + i] = MAX(m[3 * n + i], MAX(up, down));
        m[4 * n + i] += bends[i];
        m[5 * n + i] += changes[i];
    }
    memset(sum, 0, 2 * w * sizeof(uint16_t));
    memset(changes, 0, w);
    memset(low, 255, w);
    memset(high, 0, w);
    f->since = 0;
}

static void feel(frame_t *f, const uint8_t *restrict values) {
    int64_t w = f->padded, blocks = w / BLOCK, felt = 0;
    uint8_t *restrict now = f->octets, *last = now + w, *earlier = last + w, *low = earlier + w, *high = low + w;
    uint8_t *changes = high + w, *limit = changes + w, turn = (uint8_t)f->turn;
    uint16_t *sum = f->words, *bends = sum + w;
    int32_t *still = f->blocks, *settled = still + blocks, *live = settled + blocks, *ends = live + blocks;
    if (f->since >= 120) spill(f);
    const int64_t n = f->n, *restrict channels = f->channels;
    if (f->straight) for (int64_t i = 0; i < n; i++) now[i] = values[i] ^ turn;
    else for (int64_t i = 0; i < n; i++) now[i] = values[channels[i]] ^ turn;
    uint16_t bending = f->frames > 1 ? 0xFFFF : 0;
    uint8_t changing = f->frames > 0;
    for (int64_t b = 0; b < blocks; b++) {
        int64_t o = b * BLOCK;
        int other = memcmp(now + o, last + o, BLOCK);
        if (!other && settled[b]) { still[b]++; continue; }
        if (still[b]) { catch_up(last + o, low + o, high + o, sum + o, (uint16_t)still[b]); still[b] = 0; }
        note(now + o, last + o, earlier + o, low + o, high + o, changes + o, sum + o, bends + o, bending, changing);
        settled[b] = !other;
        uint8_t some = 0, full = 0;
        for (int i = 0; i < BLOCK; i++) some |= now[o + i] > limit[o + i];
        for (int i = 0; i < BLOCK; i++) full += now[o + i] > (uint8_t)f->end;
        live[b] = some;
        ends[b] = full;
    }
    f->since++;
    f->frames = MIN(f->frames + 1, 2);
    for (int64_t i = 0; i < f->felt; i++) f->force[f->active[i]] = 0.0;
    for (int64_t b = 0; b < blocks; b++)
        if (live[b])
            for (int64_t i = b * BLOCK; i < (b + 1) * BLOCK; i++)
                if (now[i] > limit[i]) {
                    double counts = signal_of(now[i], turn, f->sensor) - f->offset[i];
                    f->force[i] = f->gain[i] * counts * f->area[i];
                    f->active[felt++] = (int32_t)i;
                }
    f->felt = felt;
}

static int64_t cluster(int64_t n, const double *restrict force, double floor, double touch, const int32_t *restrict felt,
                       int64_t felt_n, const int32_t *restrict graph, int32_t *restrict work) {
    int32_t *members = work, *bounds = work + n, *label = work + 2 * n + 1, *queue = work + 3 * n + 1;
    int64_t active = 0, count = 0;
    for (int64_t i = 0; i < felt_n; i++)
        if (force[felt[i]] >= floor) members[active++] = felt[i];
    if (!active) return 0;
    bounds[0] = 0;
    for (int64_t p = 0; p < active; p++) {
        int32_t seed = members[p];
        if (label[seed]) continue;
        label[seed] = (int32_t)count + 1;
        queue[0] = seed;
        int64_t done = 0, size = 1;
        double peak = force[seed];
        while (done < size) {
            int32_t t = queue[done++];
            if (force[t] > peak) peak = force[t];
            for (int32_t e = graph[t]; e < graph[t + 1]; e++) {
                int32_t o = graph[e];
                if (!label[o] && force[o] >= floor) {
                    label[o] = (int32_t)count + 1;
                    queue[size++] = o;
                }
            }
        }
        if (peak >= touch) {
            count++;
            bounds[count] = bounds[count - 1] + (int32_t)size;
        } else
            for (int64_t i = 0; i < size; i++) label[queue[i]] = -1;
    }
    memcpy(queue, members, active * sizeof(int32_t));
    for (int64_t p = 0; p < active; p++) {
        int32_t t = queue[p], mine = label[t];
        label[t] = 0;
        if (mine > 0) members[bounds[mine - 1]++] = t;
    }
    for (int64_t i = count; i > 0; i--) bounds[i] = bounds[i - 1];
    bounds[0] = 0;
    return count;
}

static void limb_pose(const double *L, const double *G, const double *limb, const double *q, double *S) {
    double side = limb[13], c0 = cos(q[0]), s0 = -sin(q[0]), c1 = cos(side * q[1]), s1 = sin(side * q[1]);
    double R[9] = {c0, s0 * s1, s0 * c1, 0.0, c1, -s1, -s0, c0 * s1, c0 * c1};
    if (limb[14] > 0.0) {
        double c2 = cos(side * q[2]), s2 = -sin(side * q[2]), c3 = cos(q[3]), s3 = -sin(q[3]);
        for (int r = 0; r < 3; r++) {
            double x = R[3 * r] * c2 + R[3 * r + 1] * s2, y = R[3 * r + 1] * c2 - R[3 * r] * s2, z = R[3 * r + 2];
            R[3 * r] = x * c3 - z * s3;
            R[3 * r + 1] = y;
            R[3 * r + 2] = x * s3 + z * c3;
        }
    }
    memset(S, 0, 16 * sizeof(double));
    for (int k = 0; k < 3; k++) {
        double p = L[4 * k + 3] - G[4 * k + 3];
        for (int a = 0; a < 3; a++) p -= G[4 * k + a] * limb[9 + a];
        for (int r = 0; r < 3; r++) {
            double m = limb[3 * k] * R[r] + limb[3 * k + 1] * R[3 + r] + limb[3 * k + 2] * R[6 + r];
            for (int c = 0; c < 3; c++) S[4 * r + c] += m * L[4 * k + c];
            S[4 * r + 3] += m * p;
        }
    }
}

static void weights_of(double uu, double uv, double vv, double wu, double wv, double *s, double *t) {
    if (wu <= 0 && wv <= 0) { *s = 0; *t = 0; return; }
    double bu = wu - uu, bv = wv - uv;
    if (bu >= 0 && bv <= bu) { *s = 1; *t = 0; return; }
    double vc = wu * bv - bu * wv;
    if (vc <= 0 && wu >= 0 && bu <= 0) { *s = wu / uu; *t = 0; return; }
    double cu = wu - uv, cv = wv - vv;
    if (cv >= 0 && cu <= cv) { *s = 0; *t = 1; return; }
    double vb = cu * wv - wu * cv;
    if (vb <= 0 && wv >= 0 && cv <= 0) { *s = 0; *t = wv / vv; return; }
    double va = bu * cv - cu * bv;
    if (va <= 0 && bv - bu >= 0 && cu - cv >= 0) {
        double share = (bv - bu) / ((bv - bu) + (cu - cv));
        *s = 1 - share; *t = share; return;
    }
    double total = va + vb + vc;
    *s = vb / total; *t = vc / total;
}

static double closer(const double *p, const double *taxels, const int32_t *face, double best, double *p_L, double *n_L) {
    const double *a = taxels + 7 * (int64_t)face[0], *b = taxels + 7 * (int64_t)face[1], *c = taxels + 7 * (int64_t)face[2];
    double u[3], v[3], w[3], s, t, uu = 0, uv = 0, vv = 0, wu = 0, wv = 0, apart = 0;
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i]; v[i] = c[i] - a[i]; w[i] = p[i] - a[i];
        uu += u[i] * u[i]; uv += u[i] * v[i]; vv += v[i] * v[i]; wu += w[i] * u[i]; wv += w[i] * v[i];
    }
    weights_of(uu, uv, vv, wu, wv, &s, &t);
    for (int i = 0; i < 3; i++) { double d = w[i] - s * u[i] - t * v[i]; apart += d * d; }
    if (!(apart < best)) return best;
    double r = 1 - s - t;
    for (int i = 0; i < 3; i++) {
        p_L[i] = r * a[i] + s * b[i] + t * c[i];
        n_L[i] = r * a[3 + i] + s * b[3 + i] + t * c[3 + i];
    }
    return apart;
}

static void nearest(const double *p, const double *taxels, const int32_t *faces, const double *box,
                    const int32_t *cells, double *p_L, double *n_L) {
    double best = INFINITY, scale = box[3];
    int64_t nx = (int64_t)box[4], ny = (int64_t)box[5], nz = (int64_t)box[6];
    double x = (p[0] - box[0]) * scale, y = (p[1] - box[1]) * scale, z = (p[2] - box[2]) * scale;
    int64_t cx = (int64_t)floor(x), cy = (int64_t)floor(y), cz = (int64_t)floor(z);
    int64_t last = MAX(MAX(MAX(cx, nx - cx), MAX(cy, ny - cy)), MAX(cz, nz - cz)) + 1;
    int64_t first = MAX(MAX(MAX(0, -cx), MAX(cx - nx + 1, -cy)), MAX(MAX(cy - ny + 1, -cz), cz - nz + 1));
    double margin = MIN(MIN(MIN(x - cx, cx + 1 - x), MIN(y - cy, cy + 1 - y)), MIN(z - cz, cz + 1 - z));
    for (int64_t shell = first; shell <= last; shell++) {
        double least = (shell - 1 + margin) / scale;
        if (shell > 0 && best <= least * least) break;
        for (int64_t i = MAX(cx - shell, 0); i <= MIN(cx + shell, nx - 1); i++)
            for (int64_t j = MAX(cy - shell, 0); j <= MIN(cy + shell, ny - 1); j++) {
                int edge = i == cx - shell || i == cx + shell || j == cy - shell || j == cy + shell;
                int64_t step = edge ? 1 : MAX(2 * shell, 1), begin = edge ? MAX(cz - shell, 0) : cz - shell;
                for (int64_t k = begin; k <= MIN(cz + shell, nz - 1); k += step) {
                    if (k < 0) continue;
                    int64_t cell = (i * ny + j) * nz + k;
                    for (int32_t e = cells[cell]; e < cells[cell + 1]; e++)
                        best = closer(p, taxels, faces + 3 * (int64_t)cells[e], best, p_L, n_L);
                }
            }
    }
    double length = sqrt(n_L[0] * n_L[0] + n_L[1] * n_L[1] + n_L[2] * n_L[2]);
    for (int i = 0; i < 3; i++) n_L[i] /= length;
}

static void on_limb(const double *S, const double *p, double length, double side, double *u, double *y, double *z) {
    double q[3];
    for (int r = 0; r < 3; r++) q[r] = S[4 * r] * p[0] + S[4 * r + 1] * p[1] + S[4 * r + 2] * p[2] + S[4 * r + 3];
    q[1] *= side;
    double r = sqrt(q[0] * q[0] + q[1] * q[1]);
    *u = -q[2] / length;
    *y = r > 0 ? RHO * q[1] / r : 0;
    *z = r > 0 ? RHO * q[0] / r : RHO;
}

static void describe(int64_t count, const frame_t *f) {
    int32_t *members = f->work, *bounds = f->work + f->n;
    double S[16], length = f->limb[12], side = f->limb[13];
    const double *L = f->T_TL;
    limb_pose(L, f->T_TG, f->limb, f->posture, S);
    int64_t all = bounds[count];
    for (int64_t c = 0; c < count; c++) {
        double total = 0, peak = 0, area = 0, mean[3] = {0, 0, 0}, u, y, z;
        for (int64_t p = bounds[c]; p < bounds[c + 1]; p++) {
            int64_t i = members[p];
            const double *t = f->taxels + 7 * i;
            double force = f->force[i];
            total += force;
            peak = MAX(peak, force);
            area += t[6];
            for (int a = 0; a < 3; a++) mean[a] += force * t[a];
            f->indices[p] = i;
            f->places[p] = force;
            on_limb(S, t, length, side, f->places + all + p, f->places + 2 * all + p, f->places + 3 * all + p);
        }
        for (int a = 0; a < 3; a++) mean[a] /= total;
        double *V = f->vectors + 15 * c, *p_L = V, *n_L = V + 3;
        nearest(mean, f->taxels, f->faces, f->box, f->cells, p_L, n_L);
        for (int r = 0; r < 3; r++) {
            double n = L[4 * r] * n_L[0] + L[4 * r + 1] * n_L[1] + L[4 * r + 2] * n_L[2];
            V[6 + r] = L[4 * r] * p_L[0] + L[4 * r + 1] * p_L[1] + L[4 * r + 2] * p_L[2] + L[4 * r + 3];
            V[9 + r] = n;
            V[12 + r] = -total * n;
        }
        on_limb(S, p_L, length, side, &u, &y, &z);
        double *N = f->numbers + 7 * c;
        N[0] = total; N[1] = peak; N[2] = area; N[3] = u; N[4] = atan2(y, z); N[5] = y; N[6] = z;
    }
}

static void answer(int64_t c, int64_t all, const frame_t *f) {
    const int32_t *bounds = f->work + f->n;
    const int64_t m = f->fields_n;
    const double *N = f->numbers + 7 * c, *fields = f->fields;
    double least = INFINITY, u = N[3], y = N[5], z = N[6];
    int64_t closest = -1;
    for (int64_t i = 0; i < m; i++) {
        if (fields[i] != f->limb[14]) continue;
        double dx = fields[m + i] - u, dy = fields[2 * m + i] - y, dz = fields[3 * m + i] - z;
        double apart = sqrt(dx * dx + dy * dy + dz * dz);
        if (apart < fields[4 * m + i] && apart < least) { least = apart; closest = i; }
    }
    if (closest < 0) return;
    double total = 0, weights = 0, radius = fields[4 * m + closest], threshold = fields[5 * m + closest];
    for (int64_t p = bounds[c]; p < bounds[c + 1]; p++) {
        double ex = f->places[all + p] - u, ey = f->places[2 * all + p] - y, ez = f->places[3 * all + p] - z;
        double weight = 2 * radius - sqrt(ex * ex + ey * ey + ez * ez);
        if (weight > 0) { total += weight * f->places[p]; weights += weight; }
    }
    double felt = weights > 0 ? total / weights : 0;
    if (!(felt > threshold)) return;
    double gain = MIN((felt - threshold) / (fields[6 * m + closest] - threshold), 1.0) * (1.0 - least / radius);
    f->gains[closest] = MAX(f->gains[closest], gain);
}

int64_t respond(frame_t *f) {
    int64_t count = 0, n = f->n;
    for (int64_t again = 0; again < f->repeats; again++) {
        memset(f->gains, 0, f->fields_n * sizeof(double));
        feel(f, f->values + f->stride * (again & 1));
        count = cluster(n, f->force, f->floor, f->touch, f->active, f->felt, f->graph, f->work);
        if (!count) continue;
        describe(count, f);
        for (int64_t c = 0; c < count; c++) answer(c, (f->work + n)[count], f);
    }
    return count;
}
