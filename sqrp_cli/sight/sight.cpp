// The compiled part of the package: what cameras see, and what touches what. See `kernel.py` for what goes in and out.
#include "surface.hpp"

#pragma GCC visibility push(default)  // only these are seen from outside
extern "C" {

// form: a `Form`; figures: X_PG (16, by rows), half (3), center (3), radius. Solids are made once and shared by all calls.
void* solid_new(const double* vertices, int vertex_count, const int64_t* faces, int face_count, int form, const double* figures) {
    Solid* solid = new (malloc(sizeof(Solid))) Solid;
    solid->surface.build(vertices, vertex_count, faces, face_count);
    solid->form = Form(form), solid->X_PG = Pose::of(figures);
    const double* f = figures + 16;
    solid->half = {f[0], f[1], f[2]}, solid->center = {f[3], f[4], f[5]}, solid->radius = f[6];
    return solid;
}

void solid_free(void* solid) {
    static_cast<Solid*>(solid)->~Solid();
    free(solid);
}
}
#pragma GCC visibility pop
