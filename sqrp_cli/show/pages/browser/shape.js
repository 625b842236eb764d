// Poses and meshes of the JSON documents as three.js has them.

const matrix = (rows) => new THREE.Matrix4().set(...rows.flat());
const linear = (text) => new THREE.Color(text).convertSRGBToLinear();

// The rows of a pose that is given as x, y, z [m] and a quaternion x, y, z, w.
function poseRows([x, y, z, ...turn]) {
  const found = new THREE.Matrix4().compose(
    new THREE.Vector3(x, y, z),
    new THREE.Quaternion(...turn).normalize(),
    new THREE.Vector3(1, 1, 1),
  );
  const columns = found.elements;
  return [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((column) => columns[4 * column + row]));
}

// Triangles with normals that are smooth over faces that meet at less than 35 degrees.
function shape(solid, step) {
  const corner = solid.triangles,
    points = solid.vertices,
    faces = corner.length / 3;
  const at = (index) =>
    new THREE.Vector3(points[3 * index] * step, points[3 * index + 1] * step, points[3 * index + 2] * step);
  const normals = [],
    touching = new Map();
  for (let face = 0; face < faces; face++) {
    const [a, b, c] = [0, 1, 2].map((k) => at(corner[3 * face + k]));
    normals.push(b.sub(a).cross(c.sub(a)));
    for (let k = 0; k < 3; k++) {
      const index = corner[3 * face + k];
      if (!touching.has(index)) touching.set(index, []);
      touching.get(index).push(face);
    }
  }
  const unit = normals.map((normal) => normal.clone().normalize());
  const position = new Float32Array(9 * faces),
    normal = new Float32Array(9 * faces),
    limit = Math.cos((35 * Math.PI) / 180);
  for (let i = 0; i < corner.length; i++) {
    const face = Math.floor(i / 3),
      sum = new THREE.Vector3();
    for (const other of touching.get(corner[i])) if (unit[other].dot(unit[face]) > limit) sum.add(normals[other]);
    at(corner[i]).toArray(position, 3 * i);
    sum.normalize().toArray(normal, 3 * i);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
  geometry.setAttribute('normal', new THREE.BufferAttribute(normal, 3));
  return geometry;
}

function between(first, second, way) {
  if (way === 0) return matrix(first);
  const parts = [first, second].map((rows) => {
    const [position, turn, scale] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    matrix(rows).decompose(position, turn, scale);
    return { position, turn, scale };
  });
  return new THREE.Matrix4().compose(
    parts[0].position.lerp(parts[1].position, way),
    parts[0].turn.slerp(parts[1].turn, way),
    parts[0].scale,
  );
}
