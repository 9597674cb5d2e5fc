import { useEffect, useRef } from "react";

const steps = 10;
const stepMs = 160;

/** Once, when a solve that was watched ends with an answer, the cloud goes from raw to straight.
 *
 *  answered: whether the run has an answer; null while nothing is known of it. A run that had ended before anybody looked is shown
 *  straight at once, and so it is to who asked for no motion.
 */
export function useStraightening(
  jobId: string | null,
  answered: boolean | null,
  changeView: (change: { straight: number }) => void,
) {
  const watched = useRef<string | null>(null);
  useEffect(() => {
    if (answered === false) watched.current = jobId;
    if (answered !== true || jobId === null || watched.current !== jobId) return;
    watched.current = null;
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    let step = 0;
    changeView({ straight: 0 });
    const timer = window.setInterval(() => {
      step += 1;
      changeView({ straight: step / steps });
      if (step >= steps) window.clearInterval(timer);
    }, stepMs);
    return () => {
      window.clearInterval(timer);
      if (step < steps) changeView({ straight: 1 });
    };
  }, [jobId, answered, changeView]);
}
