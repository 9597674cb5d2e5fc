import { Route, Routes } from "react-router";
import { AuditScreen } from "./features/audit/screen";
import { InspectScreen } from "./features/inspect/screen";
import { PlanesScreen } from "./features/planes/screen";
import { RecordingScreen } from "./features/recording/screen";
import { ResultScreen } from "./features/result/screen";
import { SolveScreen } from "./features/solve/screen";
import { DropZone } from "./features/start/dropzone";
import { StartScreen } from "./features/start/screen";
import { StorageScreen } from "./features/storage/screen";
import { WorkspaceLayout } from "./features/workspace/layout";
import { NotFound } from "./features/workspace/notfound";
import { Boundary } from "./ui/boundary";

/** Every screen is a URL; the recording is in the path, the run and the view are in the query. */
export function App() {
  return (
    <Boundary>
      <DropZone>
        <Routes>
          <Route path="/" element={<StartScreen />} />
          <Route path="/r/:recordingId" element={<WorkspaceLayout />}>
            <Route path="recording" element={<RecordingScreen />} />
            <Route path="audit" element={<AuditScreen />} />
            <Route path="planes" element={<PlanesScreen />} />
            <Route path="solve" element={<SolveScreen />} />
            <Route path="inspect" element={<InspectScreen />} />
            <Route path="result" element={<ResultScreen />} />
          </Route>
          <Route path="/storage" element={<StorageScreen />} />
          <Route path="*" element={<NotFound />} />
        </Routes>
      </DropZone>
    </Boundary>
  );
}
