// Distances of solids, and which of them come too close while an arm moves.
#pragma once
#include "convex.hpp"

constexpr double FIRST_STRETCH = 0.08;  // motion of the arm's outermost point within half of each first stretch [m]

// A solid for a walk over the boxes of two: the tree of a mesh, or one box around any other form.
struct Boxes {
    const Surface* surface = nullptr;
    Node whole;
    Pose X_PN;  // of the boxes in the frame of the solid's parent

    explicit Boxes(const Solid& s) {
        if (!s.is_full()) { surface = &s.surface; return; }
        double r = s.half.x, h = s.half.z + (s.form == Form::capsule ? r : 0);
        whole = {{0, 0, 0}, s.form == Form::box ? s.half : V3{r, r, s.form == Form::sphere ? r : h}, 0, 1}, X_PN = s.X_PG;
    }
    const Node* root() const { return surface ? &surface->nodes[0] : &whole; }
    const Node* child(const Node* n, int k) const { return &surface->nodes[n->first + k]; }
};

// At least how far two boxes are apart, along the axes of either; X_AB: of the second one's axes in the first one's.
inline double gap(const Node& a, const Node& b, const Pose& X_AB) {
    V3 d = X_AB(b.center) - a.center, none{0, 0, 0};
    V3 p = highest(size_of(d) - a.extent - X_AB.around(b.extent), none);
    V3 q = highest(size_of(X_AB.turn_back(d)) - b.extent - X_AB.around_back(a.extent), none);
    return sqrt(most(dot(p, p), dot(q, q)));
}

inline Node around(const Triangle& t) {
    Bounds all;
    t.widen(all);
    return {0.5 * (all.low + all.high), 0.5 * (all.high - all.low), 0, 1};
}

// The distance of two solids if it is at most `limit`, otherwise ENDLESS: of forms as they are, of meshes' surfaces.
// One of at most `enough` may be too large, and so may any other unless `exact`.
inline double distance(const Solid& A, const Solid& B, const Pose& X_AB, double limit, double enough, bool exact) {
    Boxes first(A), second(B);
    Pose X = first.X_PN.inverse() * X_AB * second.X_PN, still;
    double best = ENDLESS;
    struct Open { const Node *a, *b; } open[4 * DEEPEST];
    int size = 0;
    open[size++] = {first.root(), second.root()};
    while (size) {
        Open now = open[--size];
        if (gap(*now.a, *now.b, X) > limit) continue;
        V3 e = now.a->extent, f = now.b->extent;
        if (!now.b->count) {
            bool of_b = now.a->count || dot(e, e) < dot(f, f);
            for (int k = 0; k < 2; k++) open[size++] = of_b ? Open{now.a, second.child(now.b, k)} : Open{first.child(now.a, k), now.b};
            continue;
        }
        // Each triangle by itself: one that is large and aslant is far from most of its box.
        for (int j = now.b->first; j < now.b->first + now.b->count; j++) {
            Piece two = Piece::of(B, X);
            Node box = *now.b;
            V3 normal{0, 0, 0};
            if (second.surface) {
                const Triangle& t = second.surface->triangles[j];
                two = Piece::of(Triangle{X(t.a), X(t.b), X(t.c)}), box = around(two.t), normal = cross(two.t.b - two.t.a, two.t.c - two.t.a);
                if (double length = norm(normal); length > 0) normal = (1 / length) * normal;
            }
            const Pose& X_box = second.surface ? still : X;
            auto is_far = [&](const Node& a) {
                double off = fabs(dot(normal, a.center - two.t.a)), reach = dot(size_of(normal), a.extent);
                return off - reach > limit || gap(a, box, X_box) > limit;
            };
            int bottom = size;
            open[size++] = {now.a, now.b};
            while (size > bottom) {
                const Node* a = open[--size].a;
                if (is_far(*a)) continue;
                for (int k = 0; !a->count && k < 2; k++) open[size++] = {first.child(a, k), now.b};
                for (int i = a->first; i < a->first + a->count; i++) {
                    if (first.surface && is_far(around(first.surface->triangles[i]))) continue;
                    double found = distance(first.surface ? Piece::of(first.surface->triangles[i]) : Piece::of(A, still), two, limit, enough);
                    if (found > limit) continue;
                    best = found, limit = exact ? found : enough;
                    if (best <= enough) return best;
                }
            }
        }
    }
    return best;
}

// The pose of a joint in its parent at a position: of its matrices A, B and C, by Rodrigues' formula if it turns.
inline Pose joint_pose(const double* terms, bool turns, double at) {
    double one = turns ? sin(at) : at, two = turns ? 1 - cos(at) : 0;
    Pose X;
    for (int k = 0; k < 12; k++) X.m[k] = terms[k] + one * terms[16 + k] + two * terms[32 + k];
    return X;
}

// An arm, and solids that it carries or that rest; arrays of Python, which says what each is: `motion/collision.py`.
struct Collisions {
    int64_t joints, driven, arm, spine_joints, bodies, pairs;
    const int64_t *parents, *turns;
    const double *axes, *terms, *ratios, *offsets, *radii;
    const int64_t* spine;
    const Solid* const* solids;
    const int64_t *frame, *depth, *rods_from, *rods;
    const double* X_FP;
    const int64_t *inner, *outer;
    const double* clearance;
};

// The solids of a scene at one position of the joints, and bounds of their motion around it.
class Places {
    const Collisions& S;
    List<Pose> X_WF, X_WP;
    List<V3> center;
    List<double> position, motion;
    List<int32_t> placed, bounded;  // at which position each was last
    int32_t now = 0;
    const double* variation = nullptr;

    void place(int64_t body) {
        if (placed[int(body)] == now) return;
        int64_t f = S.frame[body];
        Pose X = Pose::of(S.X_FP + 16 * body);
        placed[int(body)] = now, X_WP[int(body)] = f < 0 ? X : X_WF[int(f)] * X;
        center[int(body)] = X_WP[int(body)](S.solids[body]->center);
    }

    double step(int64_t joint) const {  // how much a joint may differ where those of the arm do by the variation
        double most_of = 0;
        for (int64_t k = 0; k < S.arm; k++) most_of += fabs(S.ratios[S.driven * joint + k]) * variation[k];
        return most_of;
    }

    // How far a joint moves the points within a radius of a body's centre, where those further out move them already.
    double moved(int64_t joint, V3 middle, double radius) const {
        const Pose& X = X_WF[int(joint)];
        const double* a = S.axes + 3 * joint;
        V3 lever = cross(middle - X.origin(), X.turn({a[0], a[1], a[2]}));
        return step(joint) * (S.turns[joint] ? norm(lever) + radius : 1);
    }

    // How far a body can move against links of each depth, as `bounds` says, and against what carries it if it is a rod.
    const double* motions(int64_t body) {
        double* m = motion.begin() + (S.spine_joints + 1) * body;
        if (bounded[int(body)] == now) return m;
        place(body), bounded[int(body)] = now;
        double sum = 0, radius = S.solids[body]->radius;
        for (int64_t k = S.rods_from[body + 1]; k-- > S.rods_from[body];) sum += moved(S.rods[k], center[int(body)], radius + sum);
        m[S.spine_joints] = sum;
        for (int64_t j = S.spine_joints; j--;) {
            if (j < S.depth[body]) sum += moved(S.spine[j], center[int(body)], radius + sum);
            m[j] = sum;
        }
        return m;
    }

public:
    explicit Places(const Collisions& scene) : S(scene) {
        int n = int(S.bodies);
        X_WF.resize(int(S.joints)), position.resize(int(S.joints)), X_WP.resize(n), center.resize(n);
        placed.resize(n), bounded.resize(n), motion.resize(n * int(S.spine_joints + 1));
        for (int i = 0; i < n; i++) placed[i] = bounded[i] = -1;
    }

    // q: of the driven joints, `stride` apart; change: how much those of the arm may differ from there, null if not at all.
    void move(const double* q, const double* change) {
        now++, variation = change;
        for (int64_t j = 0; j < S.joints; j++) {
            double at = S.offsets[j];
            for (int64_t k = 0; k < S.driven; k++) at += S.ratios[S.driven * j + k] * q[k];
            Pose X = joint_pose(S.terms + 48 * j, S.turns[j], at);
            X_WF[int(j)] = S.parents[j] < 0 ? X : X_WF[int(S.parents[j])] * X;
        }
    }

    // How far the solids of a pair can move against each other within the variation, at most [m].
    //
    // Turn the joints one after the other, the outermost first: joint j then still stands where it did, and moves a point
    // by at most its angle times the point's distance from the axis, which is the distance at the position plus what the
    // joints further out have moved the point. The motion of the whole is at most the sum.
    double bound(int64_t pair) {
        if (!variation) return 0;
        int64_t in = S.inner[pair], out = S.outer[pair], depth = S.depth[in];
        double of_rod = S.rods_from[in + 1] > S.rods_from[in] ? motions(in)[S.spine_joints] : 0;
        return motions(out)[depth] + of_rod;
    }

    // ENDLESS if a pair is further apart than its clearance and `more`; else at most the clearance if it is that close,
    // of which nothing is said where `more` is less than a resolution.
    double apart(int64_t pair, double more, double resolution) {
        int64_t in = S.inner[pair], out = S.outer[pair];
        place(in), place(out);
        const Solid &A = *S.solids[out], &B = *S.solids[in];
        double need = S.clearance[pair] + more, reach = A.radius + B.radius + need;
        V3 between = center[int(in)] - center[int(out)];
        if (dot(between, between) >= reach * reach) return ENDLESS;
        return distance(A, B, X_WP[int(out)].inverse() * X_WP[int(in)], need, more < resolution ? need : S.clearance[pair], false);
    }
};

// A search for the first contact along a path of the arm.
struct PathCheck {
    const Collisions& S;
    int64_t degree;  // of the path's Chebyshev polynomials: `coefficients` of each piece, (degree + 1, arm)
    const double *coefficients, *slopes, *breaks;
    double resolution;
    double first = ENDLESS;  // where the first contact so far is
    int64_t pair = -1;
    Places places{S};
    List<double> q, change;

    // Looks at pairs over a stretch of a piece: in its middle, then in both halves for those that that leaves open.
    void look(int64_t piece, double s, double half, const List<int64_t>& pairs) {
        double start = breaks[piece], x = 2 * (s - start) / (breaks[piece + 1] - start) - 1;
        for (int64_t j = 0; j < S.arm; j++) {  // Clenshaw's sum
            const double* c = coefficients + piece * (degree + 1) * S.arm + j;
            double above = 0, sum = 0;
            for (int64_t k = degree; k > 0; k--) {
                double next = c[k * S.arm] + 2 * x * sum - above;
                above = sum, sum = next;
            }
            q[int(j)] = c[0] + x * sum - above, change[int(j)] = slopes[piece * S.arm + j] * half;
        }
        places.move(q.begin(), change.begin());
        List<int64_t> open;
        for (int64_t p : pairs) {
            double moved = places.bound(p), found = places.apart(p, moved, resolution);
            if (found == ENDLESS) continue;
            if (moved >= resolution) open.add(p);
            if ((found <= S.clearance[p] || moved < resolution) && s < first) first = s, pair = p;
        }
        if (open.empty()) return;
        double quarter = half / 2;
        look(piece, s - quarter, quarter, open);
        if (s < first) look(piece, s + quarter, quarter, open);
    }
};
