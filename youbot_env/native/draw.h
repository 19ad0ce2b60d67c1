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
