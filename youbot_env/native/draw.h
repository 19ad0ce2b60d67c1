// Numbers in [0, 1) of one generator for each robot: NumPy's own, by its interface for C
// (numpy/random/bitgen.h).  Pointers: robots, generators, result (numbers, robots); the first number
// says how many are drawn.
typedef struct {
    void *state;
    uint64_t (*next_uint64)(void *);
    uint32_t (*next_uint32)(void *);
    double (*next_double)(void *);
    uint64_t (*next_raw)(void *);
} Generator;

void draw(void *const *p, const double *u, const long *z) {
    const int32_t *chosen = p[0];
    Generator *const *generators = p[1];
    double *result = p[2];
    const long draws = (long)u[0];
    for (long i = 0; i < z[0]; i++) {
        const Generator *source = generators[chosen[i]];
        for (long k = 0; k < draws; k++) result[k * z[0] + i] = source->next_double(source->state);
    }
}

typedef void Function(void *const *p, const double *u, const long *z);

// One period of all robots, then new episodes of those that had ended before it.
//
// Pointers 3 to 6: the functions ``step``, ``start``, ``look`` and, where each episode draws a robot,
// ``robots``; 7: which robots had ended (bytes); 8: room for their numbers; 9: room for which of the
// drawn robots are possible; 10 to 13: reward, and the three rows of bytes of the ends; 14 to 17:
// states before and after, integrals before and after, which change places.  Sizes 3 and 4: numbers drawn for an episode and for a robot; 5: how often a robot is drawn at most.  Writes to
// size 6 how many episodes began, to size 7 how many robots found no possible values.
void period(void **p, double *u, long *z) {
    const long count = z[0], tries = z[5];
    Function *const step = (Function *)p[3], *const start = (Function *)p[4];
    Function *const look = (Function *)p[5], *const robots = (Function *)p[6];
    const uint8_t *ended = p[7], *possible = p[9];
    int32_t *rows = p[8];
    long began = 0, left = 0;
    step(p, u, z);
    for (int k = 14; k < 18; k += 2) {
        void *const old = p[k];
        p[k] = p[k + 1];
        p[k + 1] = old;
    }
    for (long i = 0; i < count; i++)
        if (ended[i]) rows[began++] = (int32_t)i;
    z[6] = began;
    z[7] = 0;
    if (!began) return;
    int32_t *trying = rows + count;
    left = robots ? began : 0;
    memcpy(trying, rows, (size_t)left * sizeof *rows);
    p[0] = trying;
    for (long turn = 0; left && turn < tries; turn++) {
        long refused = 0;
        u[0] = (double)z[4];
        z[0] = z[2] = left;
        draw(p, u, z);
        robots(p, u, z);
        for (long i = 0; i < left; i++)
            if (!possible[i]) trying[refused++] = trying[i];
        left = refused;
    }
    z[7] = left;
    p[0] = rows;
    u[0] = (double)z[3];
    z[0] = z[2] = began;
    if (!left) {
        draw(p, u, z);
        start(p, u, z);
        look(p, u, z);
        for (long i = 0; i < began; i++) {
            ((float *)p[10])[rows[i]] = 0.0f;
            for (int k = 11; k < 14; k++) ((uint8_t *)p[k])[rows[i]] = 0;
        }
    }
    z[0] = count;
}
