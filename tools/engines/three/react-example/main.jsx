// A level in React Three Fiber: index.html?glb=out/level.glb, optionally with &cam=x,y,z,tx,ty,tz,fov, &exposure=X and &diffuse=1.
import { Component, Suspense, useEffect } from 'react';
import { createRoot } from 'react-dom/client';
import { Canvas, useThree } from '@react-three/fiber';
import { Vector3 } from 'three';
import { LumelLevel } from 'lumel-three/react';

const query = new URLSearchParams(location.search);
const [x, y, z, tx, ty, tz, fov] = (query.get('cam') ?? '4,3,6,0,1,0,60').split(',').map(Number);
const options = {
  exposure: query.has('exposure') ? Number(query.get('exposure')) : undefined,
  diffuse: query.has('diffuse') || undefined,
};

/** Runs after its siblings in the Suspense have been loaded and drawn. */
function Ready() {
  const { camera, size } = useThree();
  useEffect(() => {
    camera.lookAt(tx, ty, tz);
    // Screen position of a point in the level.
    globalThis.lumel = {
      project(px, py, pz) {
        camera.updateMatrixWorld();
        const at = new Vector3(px, py, pz).project(camera);
        return [(0.5 + 0.5 * at.x) * size.width, (0.5 - 0.5 * at.y) * size.height];
      },
    };
    const timer = setTimeout(() => (document.body.dataset.state = 'ready'), 500);
    return () => clearTimeout(timer);
  }, [camera, size]);
  return null;
}

/** Shows errors. */
class Fallible extends Component {
  state = {};

  static getDerivedStateFromError(error) {
    return { error };
  }

  componentDidCatch() {
    document.body.dataset.state = 'failed';
  }

  render() {
    return this.state.error ? <p>{this.state.error.message}</p> : this.props.children;
  }
}

createRoot(document.getElementById('root')).render(
  <Fallible>
    <Canvas flat camera={{ position: [x, y, z], fov, near: 0.01, far: 1000 }}>
      <Suspense fallback={null}>
        <LumelLevel url={query.get('glb') ?? 'out/level.glb'} {...options} />
        <Ready />
      </Suspense>
    </Canvas>
  </Fallible>,
);
