// What a call is about: solids, where frames are, boxes, cameras and lights; and how boxes are lit.
#pragma once
#include "camera.hpp"
#include "rays.hpp"

constexpr int MOST_LIGHTS = 8;
constexpr double FAR_LIGHT = 1000;  // from where a directional light shines [m]
constexpr double PLATE = 2e-4;      // thickness of the plate that stands for a face of a box [m]
constexpr double FAINT = 1e-3;      // intensity on a face up to which its shadow does not matter
constexpr double ROUGH = 0.02;      // share of a box up to which it counts as well lit: shares are known to 2 points

// A light as `kernel.py` writes it.
struct Light {
    double kind;  // 0: from everywhere, 1: from a direction, 2: a lamp
    double intensity;
    V3 heading, position;  // in which it shines; from where
    double cosine;         // of half its beam
};

// The arguments of a call, as `kernel.py` writes them.
struct Request {
    int64_t solid_count;
    const Solid* const* solids;
    const int64_t *solid_frame, *solid_part;  // by number; the pieces of a link are one part
    const uint8_t* is_scenery;                // whether its colour is stated, so that it can be behind a box
    const double* const* X_WF;                // poses of frames, (states or 1, 4, 4) each
    const int64_t* pose_count;                // of each frame: 1 where it never moves
    int64_t box_count;
    const Box* boxes;
    const uint8_t *opaque, *alike, *own;      // (solids, boxes): what hides, looks like and is what a box seeks
    int64_t camera_count;
    const Camera* cameras;
    int64_t light_count;
    const Light* lights;
};

struct Near { int solid; Hull hull; };  // the hull is in the frame of the solid's parent

struct Scene : Request {
    List<int> scenery, resting, moving;  // solids
    List<V3> place;                      // the centre of each one that rests
    List<uint8_t> has_alike;             // of each box, whether anything looks like what it seeks
    Scratch scratch;

    explicit Scene(const Request& request) : Request(request) {
        has_alike.resize(int(box_count)), place.resize(int(solid_count));
        for (int s = 0; s < solid_count; s++) {
            if (is_scenery[s]) scenery.add(s);
            (rests(s) ? resting : moving).add(s);
            if (rests(s)) place[s] = pose_of(s, 0)(solids[s]->center);
            for (int b = 0; b < box_count; b++) has_alike[b] |= is(alike, s, b);
        }
    }
    bool is(const uint8_t* mask, int solid, int box) const { return mask[solid * box_count + box]; }
    bool is_still(int frame) const { return pose_count[frame] == 1; }
    bool rests(int solid) const { return is_still(int(solid_frame[solid])); }
    Pose pose(int frame, int64_t state) const { return Pose::of(X_WF[frame] + (is_still(frame) ? 0 : 16 * state)); }
    Pose pose_of(int solid, int64_t state) const { return pose(int(solid_frame[solid]), state); }
    V3 center(int solid, int64_t state) const { return rests(solid) ? place[solid] : pose_of(solid, state)(solids[solid]->center); }

    // Adds those of some solids that may reach into the hull of a box.
    void find_near(const List<int>& some, const Hull& H, int box, int64_t state, List<Near>& found) const {
        for (int s : some) {
            if (!is(opaque, s, box) || H.outside(center(s, state), solids[s]->radius + TOUCH)) continue;
            Near near{s, H.in(pose_of(s, state))};
            uint32_t planes = H.all();
            if (near.hull.may_meet(solids[s]->surface.nodes[0], planes)) found.add(near);
        }
    }

    void block(Rays& rays, const Grid& grid, const Near& near, int64_t state) {
        ::block(rays, solids[near.solid]->surface, near.hull, grid.map * pose_of(near.solid, state), scratch);
    }

    // Calls `each(begin, end)` for the near solids of each part, in the order of parts and solids.
    template <class Each> void by_part(const List<Near>& near, Each each) const {
        List<const Near*> all;
        auto part = [&](const Near* n) { return solid_part[n->solid]; };
        for (const Near& n : near) all.add(&n);
        sort(all.begin(), all.end(), [&](const Near* a, const Near* b) { return part(a) != part(b) ? part(a) < part(b) : a->solid < b->solid; });
        for (int i = 0, end = 0; i < all.size(); i = end) {
            while (end < all.size() && part(all[end]) == part(all[i])) end++;
            each(all.begin() + i, all.begin() + end);
        }
    }

    // The first solid of the part that by itself hides most of a box: the first part of equals; -1 of none.
    int largest(const Grid& grid, const List<Near>& near, int64_t state) {
        int by = -1;
        double best = 2;
        by_part(near, [&](const Near** begin, const Near** end) {
            Rays blocked;
            for (const Near** n = begin; n < end; n++) block(blocked, grid, **n, state);
            if (double seen = grid.seen(blocked); seen < best) best = seen, by = (*begin)->solid;
        });
        return by;
    }
};

// How much of a box cannot be told for want or excess of light.
struct Lighting {
    double dark = 0, bright = 0, lost = 0;  // shares of what is seen; `lost`: as it counts
    int brightest = -1, shading = -1;       // the light that does most to it; the solid that keeps most light from it
};

// A box in a state as lights reach its faces: matt surfaces, each of which adds the intensity of a light times the cosine
// of its angle (Lambert's law). A light sees of a face what a camera in its place would see; the rest is in shadow.
// (docs/reference/numbers.md, "Light")
class LitBox {
    struct Face {
        bool known = false, knows_shadows = false;
        double strength[MOST_LIGHTS], reached[MOST_LIGHTS];  // intensity without shadows; share that is not in shadow
    };
    Face faces[6];
    Pose X_WB;
    int box = -1;
    int64_t state = -1;

public:
    // The lighting of a box as a camera in a place, of a gain, sees it. shadows: whether to find what shades it most.
    Lighting look(Scene& scene, int box_, int64_t state_, const Pose& X_WB_, V3 eye_W, double gain, bool shadows) {
        if (box != box_ || state != state_) {
            for (Face& face : faces) face = {};
            box = box_, state = state_, X_WB = X_WB_;
        }
        const Box& b = scene.boxes[box];
        int lights = int(scene.light_count), darkest_face = -1, darkest_light = -1;
        double ambient = 0, lowest_told = b.least_light / gain, highest_told = b.most_light / gain;
        for (int l = 0; l < lights; l++) ambient += scene.lights[l].kind == 0 ? scene.lights[l].intensity : 0;
        V3 h = b.shrunk, eye = X_WB.back(eye_W) - b.middle;
        double sum = 0, most_missing = 0, sums[MOST_LIGHTS] = {};
        Lighting found;
        for (int side = 0; side < 6; side++) {
            V3 out = normal(side), way = eye - times(out, h);
            double areas[3] = {h.y * h.z, h.x * h.z, h.x * h.y}, away = norm(way);
            double weight = areas[side / 2] * most(dot(way, out), 0.0) / (away * away * away);  // as large as it is in the image
            if (!(weight > 0)) continue;
            Face& face = faces[side];
            if (!face.known) light_up(scene, face, side);
            double brightest = 0;
            for (int l = 0; l < lights; l++) brightest += face.strength[l];
            // Where shadows change nothing, none counts, whatever cameras of other gains have asked for.
            bool asked = brightest >= lowest_told && (ambient < lowest_told || brightest > highest_told);
            if (asked != face.knows_shadows) asked ? cast_shadows(scene, face, side) : light_up(scene, face, side);
            double dark = 0, bright = 0;
            for (int on = 0; on < 1 << lights; on++) {  // which lights reach a point, by chance: shadows are independent
                double chance = 1, total = ambient;
                for (int l = 0; l < lights; l++) {
                    bool lit = on >> l & 1;
                    if (scene.lights[l].kind == 0) chance *= lit ? 0 : 1;
                    else chance *= lit ? face.reached[l] : 1 - face.reached[l], total += lit ? face.strength[l] : 0;
                }
                dark += total < lowest_told ? chance : 0, bright += total > highest_told ? chance : 0;
            }
            sum += weight, found.dark += weight * dark, found.bright += weight * bright;
            for (int l = 0; l < lights; l++) {
                sums[l] += face.strength[l] * face.reached[l] * weight;
                double missing = face.strength[l] * (1 - face.reached[l]) * weight;
                if (missing > most_missing) most_missing = missing, darkest_face = side, darkest_light = l;
            }
        }
        found.dark /= most(sum, 1e-300), found.bright /= most(sum, 1e-300);
        double share = found.dark + found.bright;
        found.lost = share <= ROUGH ? 0 : b.whole ? 1 : share;
        found.brightest = 0;
        for (int l = 1; l < lights; l++) found.brightest = sums[l] > sums[found.brightest] ? l : found.brightest;
        if (shadows && darkest_face >= 0) {
            Plate plate(*this, scene, darkest_face, scene.lights[darkest_light]);
            found.shading = scene.largest(plate.grid, plate.near, state);
        }
        return found;
    }

private:
    static V3 normal(int side) {
        double s = side % 2 ? 1 : -1;
        return side < 2 ? V3{s, 0, 0} : side < 4 ? V3{0, s, 0} : V3{0, 0, s};
    }

    // The middle of a face in the frame of its box.
    static V3 middle(const Box& b, int side, double further = 0) {
        return b.middle + times(normal(side), b.shrunk + V3{further, further, further});
    }

    // What reaches a point from a light, if nothing is in the way.
    struct Ray {
        V3 towards;
        double distance, strength;
        Ray(const Light& light, V3 point) {
            if (light.kind == 1) { towards = -1.0 * light.heading, distance = INFINITY, strength = light.intensity; return; }
            V3 way = light.position - point;
            distance = most(norm(way), 1e-6), towards = (1 / distance) * way;
            strength = -dot(towards, light.heading) >= light.cosine ? light.intensity / (distance * distance) : 0;
        }
    };

    void light_up(const Scene& scene, Face& face, int side) const {
        face.known = true, face.knows_shadows = false;
        V3 point = X_WB(middle(scene.boxes[box], side)), out = X_WB.turn(normal(side));
        for (int l = 0; l < scene.light_count; l++) {
            const Light& light = scene.lights[l];
            face.reached[l] = 1, face.strength[l] = light.intensity;
            if (light.kind == 0) continue;
            Ray ray(light, point);
            face.strength[l] = ray.strength * most(dot(ray.towards, out), 0.0);
        }
    }

    // A face as a light sees it, with what may throw a shadow on it.
    struct Plate {
        Grid grid;
        List<Near> near;
        Plate(const LitBox& lit, Scene& scene, int side, const Light& light) {
            const Box& b = scene.boxes[lit.box];
            V3 point = lit.X_WB(middle(b, side)), n = normal(side), half{n.x ? 0.5 * PLATE : b.shrunk.x, n.y ? 0.5 * PLATE : b.shrunk.y, n.z ? 0.5 * PLATE : b.shrunk.z};
            Ray ray(light, point);
            V3 forward = -1.0 * ray.towards, across = unit(cross(forward, fabs(forward.z) < 0.9 ? V3{0, 0, 1} : V3{1, 0, 0}));
            V3 down = cross(forward, across), at = point + least(ray.distance, FAR_LIGHT) * ray.towards;
            Pose X_WL{{across.x, down.x, forward.x, at.x, across.y, down.y, forward.y, at.y, across.z, down.z, forward.z, at.z}};
            Hull H = Hull::of(lit.X_WB, half, middle(b, side, 0.5 * PLATE), at);
            grid = Grid::of(H, X_WL);
            scene.find_near(scene.resting, H, lit.box, lit.state, near), scene.find_near(scene.moving, H, lit.box, lit.state, near);
        }
    };

    void cast_shadows(Scene& scene, Face& face, int side) const {
        face.knows_shadows = true;
        const Box& b = scene.boxes[box];
        double width = 2 * norm(b.shrunk);
        for (int l = 0; l < scene.light_count; l++) {
            const Light& light = scene.lights[l];
            // Between a face and a lamp that is closer to it than it is wide nothing is taken to be.
            if (light.kind == 0 || !(face.strength[l] > FAINT) || !(Ray(light, X_WB(middle(b, side))).distance > width)) continue;
            Plate plate(*this, scene, side, light);
            Rays blocked;
            for (const Near& n : plate.near) scene.block(blocked, plate.grid, n, state);
            face.reached[l] = plate.grid.seen(blocked);
        }
    }
};
