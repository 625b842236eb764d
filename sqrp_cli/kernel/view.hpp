// A box as a camera sees it in a state: within which limits, what hides it, what is behind it, and how it is lit.
#pragma once
#include "scene.hpp"

constexpr double BACK = 1e-3;          // how far before the far side of a box its background begins, so that what it stands on counts [m]
constexpr double LEAST_TELLING = 0.5;  // share of a box that must be told from what is behind it, unless its detector needs less
constexpr int BEHIND_RAYS = 16;        // across the image of a box, to what is behind it

// Views are looked at one state after the other: what depends only on what stands still is kept for the next one.
class View {
public:
    Verdict limit;
    double cut = 0;  // the share of the box that the image's edge takes, where that counts as hidden

    // Turns to a state: by a camera at a pose in its frame. Any verdict on its limits is `limit`.
    void look(const Scene& scene, const Camera& camera_, const Pose& X_FC, int box_, int64_t state_) {
        state = state_;
        if (known && still) return;
        known = true, box = box_, camera = &camera_;
        const Box& b = scene.boxes[box];
        still = scene.is_still(int(camera->frame)) && scene.is_still(int(b.frame));
        X_WC = scene.pose(int(camera->frame), state) * X_FC, X_WB = scene.pose(int(b.frame), state) * b.X_FB;
        limit = check(*camera, b, X_WC.inverse() * X_WB);
        has_hull = has_grid = has_resting = has_rays = has_outside = has_scenery = behind_moved = false;
        still_blocked = outside = {};
        still_met = behind_by = -1, cut = behind = 0;
    }

    void forget() { known = false; }

    // How the camera faces the box; see `judge` in `sight.cpp`.
    void face(const Scene& scene, double& distance, double& incidence, double& size) const {
        const Box& b = scene.boxes[box];
        Pose X_CB = X_WC.inverse() * X_WB;
        V3 corners[8];
        for (int k = 0; k < 8; k++) corners[k] = X_CB(corner(k, b.half));
        distance = norm(X_CB.origin()), incidence = incidence_of(b, X_CB, distance);
        size = limit.cause == BEHIND ? NAN : Image(*camera, corners).size();
    }

    // Finds the solids that may be in the way, for a box within all limits; how many these are.
    int find_near(const Scene& scene) {
        if (!has_hull) {
            const Box& b = scene.boxes[box];
            H = Hull::of(X_WB, b.shrunk, b.middle, X_WC.origin());
            has_hull = true;
            if (b.allows_truncation) {
                V3 corners[8];
                for (int i = 0; i < 8; i++) corners[i] = X_WC.back(H.point[i]);
                Image image(*camera, corners);
                cut = image.outside() > 0 ? 1 - image.share_within(*camera) : 0;
            }
        }
        if (!has_resting || !still) near.clear(), scene.find_near(scene.resting, H, box, state, near), resting = near.size();
        has_resting = true, near.resize(resting);
        scene.find_near(scene.moving, H, box, state, near);
        for (int i = resting + 1; i < near.size(); i++)  // what was last in the way comes first
            if (near[i].solid == in_the_way) swap(near[resting], near[i]);
        return near.size();
    }

    // The share of the box that must be visible; above 1 if none is enough. Where all that looks alike behind it is seen
    // too, enough is left to be told from it; `lost` of what is seen cannot be told, by light.
    double needed(const Scene& scene, double lost) {
        double visible = scene.boxes[box].visible, told = most(1 - lost, 1e-9);
        look_behind(scene);
        return behind > 0 || lost > 0 ? most(visible, (least(visible, LEAST_TELLING) + behind) / told) : visible;
    }

    // Whether it is seen, of what is within the limits.
    bool sees(Scene& scene, LitBox& lit) {
        find_near(scene);
        double needed_share = needed(scene, scene.light_count ? lighting(scene, lit).lost : 0);
        if (needed_share + cut > 1) return false;
        if (near.empty()) return true;
        if (scene.boxes[box].visible >= 1 && cut == 0) return !met(scene);
        return share(scene, needed_share, true) >= needed_share;
    }

    // What hides it, is behind it, or lights it badly, in this order; after `find_near`. named, shares: whether `by`, `visible` count.
    Verdict judge(Scene& scene, LitBox& lit, bool named, bool shares) {
        const Box& b = scene.boxes[box];
        Verdict found{NONE, -1, 0, 1};
        if (b.visible < 1) {
            found.visible = share(scene, shares ? NAN : b.visible);
            if (found.visible < b.visible) found.cause = HIDDEN, found.by = named ? scene.largest(rays(), near, state) : -1;
        } else if (named ? (found.by = first_met(scene)) >= 0 : met(scene)) {
            found.cause = HIDDEN;
            if (shares) found.visible = share(scene, NAN);
        }
        if (found.cause == HIDDEN) return found;
        if (found.visible < needed(scene, 0.0)) return {SAME_COLOUR, behind_by, 0, found.visible};
        if (!scene.light_count) return found;
        Lighting light = lighting(scene, lit, named);
        if (!(found.visible < needed(scene, light.lost))) return found;
        if (light.bright > light.dark) return {TOO_BRIGHT, light.brightest, 0, found.visible};
        return {TOO_DARK, light.shading, 0, found.visible};
    }

    Lighting lighting(Scene& scene, LitBox& lit, bool shadows = false) const {
        return lit.look(scene, box, state, X_WB, X_WC.origin(), camera->gain, shadows);
    }

    // How much of the box each part hides: as the first on a ray, and as the only one on it, shares of the silhouette.
    // (docs/reference/numbers.md, "Who is in the way"; of parts at the same place the first owns the ray.)
    void share_out(Scene& scene, double* first, double* alone) {
        const Grid& grid = rays();
        Depths nearest;
        int owner[ROWS][COLUMNS] = {}, blocking[ROWS][COLUMNS] = {};
        scene.by_part(near, [&](const Near** begin, const Near** end) {
            Depths own;
            for (const Near** n = begin; n < end; n++)
                block(own, grid, scene.solids[(*n)->solid]->surface, (*n)->hull, grid.map * scene.pose_of((*n)->solid, state));
            for (int k = 0; k < ROWS; k++)
                for (int c = 0; c < COLUMNS; c++) {
                    blocking[k][c] += own.of[k][c] < ENDLESS;
                    if (own.of[k][c] < nearest.of[k][c]) nearest.of[k][c] = own.of[k][c], owner[k][c] = int(scene.solid_part[(*begin)->solid]);
                }
        });
        double one = 1.0 / most(grid.total, 1);
        for (int k = 0; k < ROWS; k++)
            for (int c = 0; c < COLUMNS; c++)
                if (blocking[k][c]) first[owner[k][c]] += one, alone[owner[k][c]] += blocking[k][c] == 1 ? one : 0;
    }

private:
    bool known = false, still = false, has_hull = false, has_grid = false, has_resting = false, has_rays = false;
    int still_met = -1, box = 0, in_the_way = -1;
    int64_t state = 0;
    const Camera* camera = nullptr;
    Pose X_WC, X_WB;
    Hull H;
    List<Near> near;  // those at rest first
    int resting = 0;  // how many these are
    Grid grid;
    Rays still_blocked, outside;  // those that what rests blocks, and those outside the image
    bool has_outside = false;
    bool has_scenery = false, behind_moved = false;
    double behind = 0;  // the share of the box before something of its colour
    int behind_by = -1;
    int64_t behind_state = 0;
    List<int> behind_resting;

    // Whether any solid reaches into the hull.
    bool met(const Scene& scene) {
        if (still_met < 0) {
            still_met = 0;
            for (int i = 0; !still_met && i < resting; i++) still_met = meets(*scene.solids[near[i].solid], near[i].hull);
        }
        bool found = still_met;
        for (int i = resting; !found && i < near.size(); i++)
            if ((found = meets(*scene.solids[near[i].solid], near[i].hull))) in_the_way = near[i].solid;
        return found;
    }

    // The solid that is named as hiding a box that must be seen whole, -1 if none does: the first on the ray to the
    // box's centre, else the one with the point in the hull that is nearest to the eye.
    int first_met(const Scene& scene) const {
        List<const Near*> hit;
        for (const Near& n : near)
            if (meets(*scene.solids[n.solid], n.hull)) hit.add(&n);
        if (hit.size() < 2) return hit.empty() ? -1 : hit[0]->solid;
        sort(hit.begin(), hit.end(), [](const Near* a, const Near* b) { return a->solid < b->solid; });
        double best = ENDLESS;
        int by = -1;
        for (const Near* n : hit) {
            V3 eye = n->hull.eye(), center = scene.pose_of(n->solid, state).back(X_WB.origin());
            double found = first_hit(scene.solids[n->solid]->surface, eye, center - eye, best);
            if (found < best) best = found, by = n->solid;
        }
        if (best <= 1) return by;
        best = ENDLESS;
        for (const Near* n : hit) {
            double found = nearest_inside(scene.solids[n->solid]->surface, n->hull, best);
            if (found < best) best = found, by = n->solid;
        }
        return by >= 0 ? by : hit[0]->solid;
    }

    const Grid& rays() { return has_grid ? grid : (has_grid = true, grid = Grid::of(H, X_WC)); }

    // The share that is visible; once it is less than `enough`, any other one that is; NAN: it must be exact. decide: whether
    // it need be no more exact where it is enough, and what the image's edge takes counts as hidden.
    double share(Scene& scene, double enough, bool decide = false) {
        if (near.empty()) return 1;
        const Grid& g = rays();
        int first = still ? resting : 0, n = near.size();
        if (still && !has_rays)
            for (int i = 0; i < resting; i++) scene.block(still_blocked, g, near[i], state);
        has_rays = true;
        Rays blocked = still ? still_blocked : Rays();
        double seen = g.seen(blocked);
        List<Share>& rest = scene.scratch.rest;  // what the solids from each on block at least
        rest.clear();
        for (int i = first; decide && i < n; i++) {
            Rays around;
            around.add_around(g.map * scene.pose_of(near[i].solid, state), scene.solids[near[i].solid]->surface.nodes[0]);
            // The more a solid may hide, the sooner it decides, and soonest what hid the box last.
            rest.add({near[i].solid == in_the_way ? -1 : g.seen(around), i, around});
        }
        sort(rest.begin(), rest.end(), [](const Share& a, const Share& b) { return a.seen < b.seen; });
        for (int k = rest.size() - 1; k-- > 0;) rest[k].around = rest[k].around | rest[k + 1].around;
        for (int k = 0; !(seen < enough); k++) {
            bool last = k == n - first;
            double least_seen = decide ? share_in_image(last ? blocked : blocked | rest[k].around, enough) : seen;
            if (last || (decide && least_seen >= enough)) return least_seen;
            const Near& next = near[decide ? rest[k].near : first + k];
            scene.block(blocked, g, next, state), seen = g.seen(blocked);
            if (seen < enough) in_the_way = next.solid;
        }
        return seen;
    }

    // The share of the box that is in the image and visible, if it is enough; else any that is not.
    double share_in_image(const Rays& blocked, double enough) {
        double seen = grid.seen(blocked);
        if (seen < enough || cut <= 0) return seen;
        if (!has_outside)
            for (int k = 0; k < ROWS; k++)
                for (uint32_t left = grid.silhouette.row[k]; left; left &= left - 1)
                    if (int c = __builtin_ctz(left); !camera->has(grid.direction(k, c))) outside.row[k] |= 1u << c;
        has_outside = true;
        return grid.seen(blocked | outside);
    }

    // Finds the share of the box before something of its colour: rays from the camera through the box go on to the first
    // object behind it (docs/reference/numbers.md, "Same colour"). The robot does not count, as its colours are not stated.
    void look_behind(const Scene& scene) {
        if (!scene.has_alike[box] || (has_scenery && behind_state == state)) return;
        bool fresh = !has_scenery || !still;
        V3 eye = X_WC.origin();
        double nearest = ENDLESS;
        for (int i = 0; i < 8; i++) nearest = least(nearest, norm(H.point[i] - eye));
        List<int> back;
        if (fresh) behind_resting.clear();
        for (int s : behind_resting) back.add(s);
        for (int s : scene.scenery) {
            bool rests = scene.rests(s);
            if ((rests && !fresh) || scene.is(scene.own, s, box)) continue;
            // In the cone around the box, and not before it.
            V3 center = scene.center(s, state);
            double radius = scene.solids[s]->radius;
            if (H.outside(center, radius + TOUCH) & ~H.far || norm(center - eye) + radius + TOUCH <= nearest) continue;
            back.add(s);
            if (rests) behind_resting.add(s);
        }
        bool moved = back.size() != behind_resting.size(), same = !fresh && !moved && !behind_moved;
        has_scenery = true, behind_moved = moved, behind_state = state;
        if (same) return;
        behind = 0, behind_by = -1;
        bool may_be = false;
        for (int s : back) may_be |= scene.is(scene.alike, s, box);
        if (may_be) count_behind(scene, back);
    }

    void count_behind(const Scene& scene, List<int>& back) {
        sort(back.begin(), back.end(), [](int a, int b) { return a < b; });
        V3 eye = X_WC.origin(), half = scene.boxes[box].shrunk, from = X_WB.back(eye) - scene.boxes[box].middle;
        Bounds all;
        for (int i = 0; i < 8; i++) all.add(flat(X_WC.back(H.point[i])));
        double u = all.low.x, v = all.low.y;
        List<Pose> X_WP;
        List<int> hits;
        for (int s : back) X_WP.add(scene.pose_of(s, state)), hits.add(0);
        int inside = 0;
        for (int i = 0; i < BEHIND_RAYS; i++)
            for (int j = 0; j < BEHIND_RAYS; j++) {
                V3 ray = unit(X_WC.turn({u + (j + 0.5) / BEHIND_RAYS * (all.high.x - u), v + (i + 0.5) / BEHIND_RAYS * (all.high.y - v), 1}));
                double enter, leave, best = ENDLESS;
                slab(from, X_WB.turn_back(ray), half, enter, leave);
                if (!(enter < leave && leave > 0)) continue;
                inside++;
                V3 start = eye + (leave - BACK) * ray;
                int which = -1;
                for (int k = 0; k < back.size(); k++) {
                    const Solid& s = *scene.solids[back[k]];
                    V3 start_P = X_WP[k].back(start), ray_P = X_WP[k].turn_back(ray);
                    double along = ENDLESS;
                    if (s.form == Form::box) {
                        slab(s.X_PG.back(start_P), s.X_PG.turn_back(ray_P), s.half, enter, leave);
                        if (enter <= leave && leave > 0) along = most(enter, 0.0);
                    } else along = first_hit(s.surface, start_P, ray_P, best);
                    if (along < best) best = along, which = k;
                }
                if (which >= 0) hits[which]++;
            }
        int total = 0, best = 0;
        for (int k = 0; k < back.size(); k++) {
            if (!scene.is(scene.alike, back[k], box)) continue;
            total += hits[k];
            if (hits[k] > best) best = hits[k], behind_by = back[k];
        }
        behind = double(total) / most(inside, 1);
    }
};

// Whether a camera at a pose in its frame sees boxes in a state; views, lit: of each, to be kept for the next one.
inline bool sees_all(Scene& scene, const Camera& camera, const Pose& X_FC, int first, int count, int64_t state, View* views, LitBox* lit, bool limits_only) {
    bool sees = true;
    for (int b = 0; sees && b < count; b++) views[b].look(scene, camera, X_FC, first + b, state), sees = views[b].limit.cause == NONE;
    for (int b = 0; sees && !limits_only && b < count; b++) sees = views[b].sees(scene, lit[b]);
    return sees;
}
