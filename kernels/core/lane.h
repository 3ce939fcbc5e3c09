// The lanes of a work-item: how many paths it carries side by side, and every operation that depends on that number.
//
// A work-item carries LANES paths: 16, 8 or 4 on a CPU, where a path's number sits in one lane of a vector register, and 1 on
// a GPU, where all this compiles to scalars. This is the only file that knows. Above it a `vfloat` is a number, a `vmask` the
// truth of a statement about it, and `condition ? a : b` chooses lane by lane.
//
// A vmask is what a comparison gives: all ones in vectors, 1 in scalars. Combine masks with & and |, negate with !, never with
// ~ and never by arithmetic. No result may depend on LANES: lanes never exchange numbers of one path, only whole paths
// (integrator/regroup.h), rows of tables and counts.
#ifndef CORE_LANE_H
#define CORE_LANE_H

#pragma OPENCL FP_CONTRACT OFF

#ifndef LANES
#error "LANES is not set: build with -D LANES=1, 4, 8 or 16"
#endif

// Of kernels that follow paths: the host says how many work-items are in a group where a compiler has to know, since registers are then
// shared out for so many and no launch fails for lack of them (CL_OUT_OF_RESOURCES).
#ifdef WORK_GROUP
#define GROUPED __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1)))
#else
#define GROUPED
#endif

#define LANE_PASTE_(name, n) name##n
#define LANE_PASTE(name, n) LANE_PASTE_(name, n)
#if LANES == 1
#define LANE_N(name) name
#else
#define LANE_N(name) LANE_PASTE(name, LANES)
#endif

// How many packets of LANES paths a work-item carries: while some of their rays wait for memory, others go on. More than one only in
// path tracing, where rays part (integrator/path.h).
#ifndef PACKETS
#define PACKETS 1
#endif
#define EACH_PACKET(k) for (uint k = 0; k < PACKETS; ++k)

typedef LANE_N(float) vfloat;
typedef LANE_N(int) vint;
typedef LANE_N(uint) vuint;
typedef LANE_N(int) vmask;

#define vfloat_bits(x) LANE_N(as_uint)(x)
#define vfloat_from_bits(x) LANE_N(as_float)(x)
#define vfloat_of(x) LANE_N(convert_float)(x)
#define vint_of(x) LANE_N(convert_int)(x)
#define vuint_of(x) LANE_N(convert_uint)(x)
#define vuint_from_int(x) LANE_N(as_uint)(x)
#define vint_from_uint(x) LANE_N(as_int)(x)
#define splat(x) ((vfloat)(x))
#define splat_uint(x) ((vuint)(x))

// In no lane, and in all.
static vmask mask_none(void) { return (vmask)(0); }
static vmask mask_all(void) { return !mask_none(); }

// fmin and fmax of vectors are slow on some CPU drivers and differ in the sign of zero: comparisons do neither.
static vfloat lesser(vfloat a, vfloat b) { return a < b ? a : b; }
static vfloat greater(vfloat a, vfloat b) { return a > b ? a : b; }

// Whether the statement holds in any lane. Narrowed to bytes first, a mask is one or two words to look at; any() of the language
// is ten times slower on some CPU drivers.
static int lane_any(vmask m) {
#if LANES == 16
    const long2 words = as_long2(convert_char16(m));
    return (words.x | words.y) != 0;
#elif LANES == 8
    return as_long(convert_char8(m)) != 0;
#elif LANES == 4
    return as_int(convert_char4(m)) != 0;
#else
    return m;
#endif
}

// In how many lanes it holds.
static int lane_count(vmask m) {
    const vint one = m ? (vint)(1) : (vint)(0);
#if LANES == 16
    const int8 h = one.lo + one.hi;
    const int4 q = h.lo + h.hi;
    return q.x + q.y + q.z + q.w;
#elif LANES == 8
    const int4 q = one.lo + one.hi;
    return q.x + q.y + q.z + q.w;
#elif LANES == 4
    return one.x + one.y + one.z + one.w;
#else
    return one;
#endif
}

// The smallest number in any lane.
static float lane_least(vfloat x) {
#if LANES == 16
    const float8 h = x.lo < x.hi ? x.lo : x.hi;
    const float4 q = h.lo < h.hi ? h.lo : h.hi;
    const float2 p = q.lo < q.hi ? q.lo : q.hi;
    return p.x < p.y ? p.x : p.y;
#elif LANES == 8
    const float4 q = x.lo < x.hi ? x.lo : x.hi;
    const float2 p = q.lo < q.hi ? q.lo : q.hi;
    return p.x < p.y ? p.x : p.y;
#elif LANES == 4
    const float2 p = x.lo < x.hi ? x.lo : x.hi;
    return p.x < p.y ? p.x : p.y;
#else
    return x;
#endif
}

// 0, 1, 2, … : the number of each lane.
static vuint lane_index(void) {
#if LANES == 16
    return (uint16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif LANES == 8
    return (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
#elif LANES == 4
    return (uint4)(0, 1, 2, 3);
#else
    return 0;
#endif
}

// Lanes and memory that only this work-item sees. Private arrays are LANES long.
#if LANES == 1
#define lane_store(vector, array) ((array)[0] = (vector))
#define lane_restore(array) ((array)[0])
#define lane_load(pointer) (*(pointer))
#define lane_save(vector, pointer) (*(pointer) = (vector))
#else
#define lane_store(vector, array) LANE_N(vstore)((vector), 0, (array))
#define lane_restore(array) LANE_N(vload)(0, (array))
#define lane_load(pointer) LANE_N(vload)(0, (pointer))
#define lane_save(vector, pointer) LANE_N(vstore)((vector), 0, (pointer))
#endif

// The largest count in any lane.
static uint lane_largest_uint(vuint x) {
    uint value[LANES];
    lane_store(x, value);
    uint largest = 0;
    for (int lane = 0; lane < LANES; ++lane) largest = max(largest, value[lane]);
    return largest;
}

// Of the lanes for which the statement holds the first alone.
static vmask lane_first(vmask m) {
    const vfloat number = vfloat_of(vint_from_uint(lane_index()));
    return m & (number == lane_least(m ? number : splat((float)LANES)));
}

// The rank of each lane among those for which the statement holds, counted from lane 0.
static vuint lane_rank(vmask m) {
    int one[LANES];
    uint rank[LANES];
    lane_store((m ? (vint)(1) : (vint)(0)), one);
    uint n = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        rank[lane] = n;
        n += (uint)one[lane];
    }
    return lane_restore(rank);
}

// Ask for a line of memory before it is needed, where the driver can do that: the host says so.
#ifdef PREFETCH
#define prefetch_line(address) __builtin_prefetch(address)
#else
#define prefetch_line(address) ((void)(address))
#endif
// The lines with each lane's place in a table.
static void lane_prefetch(__global const float* table, vuint index) {
#ifdef PREFETCH
    uint at[LANES];
    lane_store(index, at);
    for (int lane = 0; lane < LANES; ++lane) prefetch_line(table + at[lane]);
#endif
}

// A number for each lane, from its own place in an array. Written out: of a loop over the lanes compilers make a gather instruction with
// its indices and its result in memory, five times as slow.
#if LANES == 16
#define LANE_LOOK_UP(type, array, at)                                                                                    \
    (type##16)(array[at.s0], array[at.s1], array[at.s2], array[at.s3], array[at.s4], array[at.s5], array[at.s6], array[at.s7], \
               array[at.s8], array[at.s9], array[at.sa], array[at.sb], array[at.sc], array[at.sd], array[at.se], array[at.sf])
#elif LANES == 8
#define LANE_LOOK_UP(type, array, at) \
    (type##8)(array[at.s0], array[at.s1], array[at.s2], array[at.s3], array[at.s4], array[at.s5], array[at.s6], array[at.s7])
#elif LANES == 4
#define LANE_LOOK_UP(type, array, at) (type##4)(array[at.s0], array[at.s1], array[at.s2], array[at.s3])
#else
#define LANE_LOOK_UP(type, array, at) ((array)[at])
#endif
static vfloat lane_gather(__global const float* table, vuint index) { return LANE_LOOK_UP(float, table, index); }

// A table of rows, sixteen floats each, read at another row in every lane: `columns[k]` is then the k-th number of each lane's row.
// OpenCL C has no gather; loading whole rows and transposing them costs a fifth of picking numbers one by one, and a row is one
// cache line.
#if LANES == 1
__attribute__((always_inline)) static void lane_rows(__global const float* table, vuint row, vfloat columns[16]) {
    // vload16 promises an alignment of one float only, which some compilers make sixteen loads of: tables begin where a buffer does
    __global const float4* r = (__global const float4*)table + (size_t)row * 4;
    #pragma unroll
    for (int i = 0; i < 4; ++i) {
        const float4 four = r[i];
        columns[4 * i] = four.x, columns[4 * i + 1] = four.y, columns[4 * i + 2] = four.z, columns[4 * i + 3] = four.w;
    }
}
// Eight numbers of a table, from `index` on.
static void lane_octets(__global const float* table, vuint index, vfloat columns[8]) {
    for (int i = 0; i < 8; ++i) columns[i] = table[index + (uint)i];
}
// A row of a table that only this work-item has; and to write its only one.
static void lane_own_rows(const float* table, vuint row, vfloat columns[16]) {
    for (int i = 0; i < 16; ++i) columns[i] = table[row * 16 + i];
}
static void lane_write_rows(const vfloat columns[16], float* table) {
    for (int i = 0; i < 16; ++i) table[i] = columns[i];
}
#else
#if LANES == 16
#define LANE_ZIP_LOW(a, b)                                                                                                  \
    (float16)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3, a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7)
#define LANE_ZIP_HIGH(a, b)                                                                                                 \
    (float16)(a.s8, b.s8, a.s9, b.s9, a.sa, b.sa, a.sb, b.sb, a.sc, b.sc, a.sd, b.sd, a.se, b.se, a.sf, b.sf)
#elif LANES == 8
#define LANE_ZIP_LOW(a, b) (float8)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3)
#define LANE_ZIP_HIGH(a, b) (float8)(a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7)
#else
#define LANE_ZIP_LOW(a, b) (float4)(a.s0, b.s0, a.s1, b.s1)
#define LANE_ZIP_HIGH(a, b) (float4)(a.s2, b.s2, a.s3, b.s3)
#endif
// One stage of a transposition: a perfect shuffle of `count` rows. Bits of a number's place move round by one: the first bit of its row
// becomes the last bit of its column, and the first bit of its column the last of its row.
__attribute__((always_inline)) static void lane_shuffle_rows(const vfloat* from, vfloat* to, int count) {
    #pragma unroll
    for (int i = 0; i < count / 2; ++i) {
        const vfloat a = from[i], b = from[i + count / 2];
        to[2 * i] = LANE_ZIP_LOW(a, b);
        to[2 * i + 1] = LANE_ZIP_HIGH(a, b);
    }
}

// A block of LANES × LANES.
__attribute__((always_inline)) static void lane_transpose(const vfloat from[LANES], vfloat to[LANES]) {
    vfloat a[LANES];
#if LANES == 4
    lane_shuffle_rows(from, a, LANES);
    lane_shuffle_rows(a, to, LANES);
#else
    vfloat b[LANES];
    lane_shuffle_rows(from, a, LANES);
    lane_shuffle_rows(a, b, LANES);
#if LANES == 8
    lane_shuffle_rows(b, to, LANES);
#else
    lane_shuffle_rows(b, a, LANES);
    lane_shuffle_rows(a, to, LANES);
#endif
#endif
}
__attribute__((always_inline)) static void lane_rows(__global const float* table, vuint row, vfloat columns[16]) {
    uint rows[LANES];
    lane_store(row, rows);
    #pragma unroll
    for (int block = 0; block < 16; block += LANES) {
        vfloat lines[LANES];
        #pragma unroll
        for (int lane = 0; lane < LANES; ++lane) lines[lane] = lane_load(table + (size_t)rows[lane] * 16 + block);
        lane_transpose(lines, columns + block);
    }
}

// The same of a table that only this work-item has; and to write LANES rows of it.
__attribute__((always_inline)) static void lane_own_rows(const float* table, vuint row, vfloat columns[16]) {
    uint rows[LANES];
    lane_store(row, rows);
    #pragma unroll
    for (int block = 0; block < 16; block += LANES) {
        vfloat lines[LANES];
        #pragma unroll
        for (int lane = 0; lane < LANES; ++lane) lines[lane] = lane_load(table + rows[lane] * 16 + block);
        lane_transpose(lines, columns + block);
    }
}
__attribute__((always_inline)) static void lane_write_rows(const vfloat columns[16], float* table) {
    #pragma unroll
    for (int block = 0; block < 16; block += LANES) {
        vfloat lines[LANES];
        lane_transpose(columns + block, lines);
        #pragma unroll
        for (int lane = 0; lane < LANES; ++lane) lane_save(lines[lane], table + lane * 16 + block);
    }
}

// Eight numbers of a table for each lane, from `index` on.
__attribute__((always_inline)) static void lane_octets(__global const float* table, vuint index, vfloat columns[8]) {
    uint at[LANES];
    lane_store(index, at);
#if LANES == 16
    // Two lanes in a row, so that four shuffles bring every number to its lane
    vfloat a[8], b[8];
    #pragma unroll
    for (int i = 0; i < 8; ++i) {
        a[i].lo = vload8(0, table + at[2 * i]);
        a[i].hi = vload8(0, table + at[2 * i + 1]);
    }
    lane_shuffle_rows(a, b, 8);
    lane_shuffle_rows(b, a, 8);
    lane_shuffle_rows(a, b, 8);
    lane_shuffle_rows(b, columns, 8);
#else
    #pragma unroll
    for (int block = 0; block < 8; block += LANES) {
        vfloat lines[LANES];
        #pragma unroll
        for (int lane = 0; lane < LANES; ++lane) lines[lane] = lane_load(table + at[lane] + block);
        lane_transpose(lines, columns + block);
    }
#endif
}
#endif

#endif
