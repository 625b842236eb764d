// The compiled part of the package: what cameras see, and what touches what. See `kernel.py` for what goes in and out.
#include "collision.hpp"
#include "view.hpp"

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

void solid_free(void* solid) { static_cast<Solid*>(solid)->~Solid(), free(solid); }

constexpr int8_t UNKNOWN = -1, UNSEEN = 0, SEEN = 1;

// Whether cameras see all boxes of the targets of questions, as far as it matters: sights (cameras, questions), UNKNOWN
// before the call. A question: a target, of `count` boxes from `first` on, in a state, that `needed` cameras must
// see.
// Ends as soon as a target loses as much as one of the bars (bars, 2): `steps` (states, 2) up to states in which it is seen
// as little as in the question before.
void cover(const Request* request, int questions, const int64_t* state, const int64_t* first, const int64_t* count,
           const int64_t* needed, int bar_count, const double* bars, const double* steps, int8_t* sights) {
    Scene scene(*request);
    List<View> views;   // (cameras, boxes)
    List<LitBox> lit;
    List<uint8_t> saw;  // whether each camera saw the present target when it was asked last
    double lost[2];     // by the present target
    bool was_unseen = false;
    views.resize(int(request->camera_count * request->box_count)), lit.resize(int(request->box_count));
    for (int q = 0; q < questions; q++) {
        if (!q || first[q] != first[q - 1] || count[q] != count[q - 1])
            saw.clear(), saw.resize(int(request->camera_count)), was_unseen = false, lost[0] = lost[1] = 0;
        int64_t seen = 0, left = request->camera_count;  // how many cameras see it, and may
        auto sight = [&](int c) -> int8_t& { return sights[size_t(c) * questions + q]; };
        auto ask = [&](int c) {
            const Camera& camera = request->cameras[c];
            View* own = views.begin() + c * request->box_count + first[q];
            bool sees = sees_all(scene, camera, camera.X_FC, int(first[q]), int(count[q]), state[q], own, lit.begin() + first[q], false);
            sight(c) = sees ? SEEN : UNSEEN, saw[c] = sees, seen += sees, left -= !sees;
        };
        auto is_open = [&] { return seen < needed[q] && left >= needed[q]; };
        for (int pass = 0; pass < 2; pass++)  // those first that saw it last
            for (int c = 0; c < request->camera_count && is_open(); c++)
                if (sight(c) == UNKNOWN && (pass || saw[c])) ask(c);
        for (int k = 0; bar_count && was_unseen && seen < needed[q] && k < 2; k++) lost[k] += steps[2 * state[q] + k];
        was_unseen = seen < needed[q];
        for (int b = 0; b < bar_count; b++)
            if (lost[0] >= bars[2 * b] && lost[1] >= bars[2 * b + 1]) return;
    }
}

// What every camera makes of n boxes in states, (cameras, n) each. by, visible: not found out if they are null. facing: if it
// is not null, only limits count that do not depend on the scene, and it becomes the distance, the incidence and the size of
// the boxes, (3, cameras, n); sizes are NAN behind a camera.
void judge(const Request* request, int n, const int64_t* box, const int64_t* state, int8_t* cause, int64_t* by, double* figure,
           double* visible, double* facing) {
    Scene scene(*request);
    List<View> views;
    LitBox lit;
    views.resize(int(request->camera_count));
    for (int i = 0; i < n; i++) {
        if (i && box[i] != box[i - 1])
            for (View& view : views) view.forget();
        for (int c = 0; c < request->camera_count; c++) {
            size_t at = size_t(c) * n + i, all = size_t(request->camera_count) * n;
            View& view = views[c];
            view.look(scene, request->cameras[c], request->cameras[c].X_FC, int(box[i]), state[i]);
            Verdict found = view.limit;
            if (facing) view.face(scene, facing[at], facing[all + at], facing[2 * all + at]);
            else if (found.cause == NONE) view.find_near(scene), found = view.judge(scene, lit, by, visible);
            cause[at] = int8_t(found.cause), figure[at] = found.figure;
            if (by) by[at] = found.by;
            if (visible) visible[at] = found.visible;
        }
    }
}

// How much of boxes within all limits each part hides from cameras: first and alone (n, parts); see `View::share_out`.
void occluders(const Request* request, int n, const int64_t* box, const int64_t* camera, const int64_t* state, int parts, double* first, double* alone) {
    Scene scene(*request);
    View view;
    for (int i = 0; i < n; i++) {
        const Camera& c = request->cameras[camera[i]];
        if (i && (box[i] != box[i - 1] || camera[i] != camera[i - 1])) view.forget();
        view.look(scene, c, c.X_FC, int(box[i]), state[i]);
        if (view.find_near(scene)) view.share_out(scene, first + size_t(i) * parts, alone + size_t(i) * parts);
    }
}

// Which items lenses, the request's cameras, see from poses X_FC (poses, 4, 4) in their common frame: (lenses, poses, items),
// 1 or 0. An item: `count` boxes from `first` on, in a state. decisive: (items,) or null, 1 where a pose from which no lens
// sees the item is given up: what follows then comes out unseen. limits_only: whether occlusion and light count not.
void look_from(const Request* request, int poses, const double* X_FC, int items, const int64_t* state, const int64_t* first,
               const int64_t* count, const uint8_t* decisive, int limits_only, uint8_t* sees) {
    Scene scene(*request);
    int lenses = int(request->camera_count);
    List<View> views;    // (lenses, boxes) of the present pose
    List<LitBox> lit;
    views.resize(lenses * int(request->box_count)), lit.resize(int(request->box_count));
    for (int p = 0; p < poses; p++) {
        for (View& view : views) view.forget();
        bool given_up = false;
        for (int i = 0; i < items && !given_up; i++) {
            given_up = decisive && decisive[i];
            for (int lens = 0; lens < lenses; lens++) {
                View* own = views.begin() + lens * request->box_count + first[i];
                bool good = sees_all(scene, request->cameras[lens], Pose::of(X_FC + 16 * p), int(first[i]), int(count[i]), state[i], own, lit.begin() + first[i], limits_only);
                sees[(size_t(lens) * poses + p) * items + i] = good, given_up = given_up && !good;
            }
        }
    }
}

// World poses (joints, m, 4, 4) of joints, parents first, at m positions (m, joints).
void joint_poses(int64_t joints, const int64_t* parents, const int64_t* turns, const double* terms, int64_t m, const double* q, double* X_WJ) {
    for (int64_t j = 0; j < joints; j++)
        for (int64_t i = 0; i < m; i++) {
            Pose X = joint_pose(terms + 48 * j, turns[j], q[i * joints + j]);
            if (parents[j] >= 0) X = Pose::of(X_WJ + 16 * (parents[j] * m + i)) * X;
            double *to = X_WJ + 16 * (j * m + i), last[4] = {0, 0, 0, 1};
            memcpy(to, X.m, sizeof X.m), memcpy(to + 12, last, sizeof last);
        }
}

// The distance of two solids, see `distance`; X_AB: of the second one's parent in that of the first one.
double solid_distance(const void* first, const void* second, const double* X_AB, double limit, double enough) {
    return distance(*static_cast<const Solid*>(first), *static_cast<const Solid*>(second), Pose::of(X_AB), limit, enough, true);
}

// Which pairs are closer than their clearance at each of m positions of all driven joints: found, (m, pairs). Only the last
// one of each if not `all`.
void collisions_touching(const Collisions* scene, const double* q, int64_t m, int64_t all, uint8_t* found) {
    Places places(*scene);
    for (int64_t i = 0; i < m; i++) {
        places.move(q + i * scene->driven, nullptr);
        for (int64_t p = scene->pairs; p--;) {
            found[i * scene->pairs + p] = places.apart(p, 0, ENDLESS) != ENDLESS;
            if (found[i * scene->pairs + p] && !all) break;
        }
    }
}

// Bounds of the motion of each pair around a position of the driven joints, of which those of the arm may differ by a change.
void collisions_bounds(const Collisions* scene, const double* q, const double* change, double* bounds) {
    Places places(*scene);
    places.move(q, change);
    for (int64_t p = 0; p < scene->pairs; p++) bounds[p] = places.bound(p);
}

// The first pair that comes too close along a path of `pieces`, -1 if none does, and where: `s`. fingers: positions of the
// driven joints that rest.
int64_t collisions_first(const Collisions* scene, int64_t pieces, int64_t degree, const double* breaks, const double* coefficients,
                            const double* slopes, const double* fingers, double resolution, double* s) {
    PathCheck check{*scene, degree, coefficients, slopes, breaks, resolution};
    check.q.resize(int(scene->driven)), check.change.resize(int(scene->arm));
    for (int64_t j = scene->arm; j < scene->driven; j++) check.q[int(j)] = fingers[j - scene->arm];
    List<int64_t> pairs;
    for (int64_t p = 0; p < scene->pairs; p++) pairs.add(p);
    for (int64_t piece = 0; piece < pieces; piece++) {
        double motion = 0, start = breaks[piece], width = breaks[piece + 1] - start;
        for (int64_t j = 0; j < scene->arm; j++) motion += slopes[piece * scene->arm + j] * scene->radii[j] * width;
        int64_t count = int64_t(most(1.0, ceil(motion / (2 * FIRST_STRETCH))));
        double half = width / double(2 * count);
        for (int64_t k = 0; k < count; k++) {
            double middle = start + half * double(2 * k + 1);
            if (middle - half < check.first) check.look(piece, middle, half, pairs);
        }
    }
    *s = check.first;
    return check.pair;
}
}
#pragma GCC visibility pop
