// What every render needs beside its integrator, as one program: to a compiler the beginning of a program costs as much as several kernels,
// and a driver takes as long to find five programs in its cache as to read one.
#include "film/accumulate.cl"
#include "geometry/build_collapse.cl"
#include "geometry/build_columns.cl"
#include "geometry/build_merge.cl"
#include "geometry/build_order.cl"
#include "geometry/rows.cl"
