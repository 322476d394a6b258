import de.mpg.cbs.core.shape.ShapeTopologyCorrection2;
import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.file.Files;
import java.nio.file.Path;

/** Topology correction by nighres: see corrector.py. Arguments: input, output, three sizes, three spacings, topology,
 *  propagation, folder of look-up tables. */
public class TopologyCorrection {
    public static void main(String[] given) throws IOException {
        int x = Integer.parseInt(given[2]), y = Integer.parseInt(given[3]), z = Integer.parseInt(given[4]);
        float[] values = new float[x * y * z];
        byte[] read = Files.readAllBytes(Path.of(given[0]));
        ByteBuffer.wrap(read).order(ByteOrder.LITTLE_ENDIAN).asFloatBuffer().get(values);
        ShapeTopologyCorrection2 algorithm = new ShapeTopologyCorrection2();
        algorithm.setDimensions(x, y, z);
        algorithm.setResolutions(Float.parseFloat(given[5]), Float.parseFloat(given[6]), Float.parseFloat(given[7]));
        algorithm.setShapeImage(values);
        algorithm.setShapeImageType("binary_object");
        algorithm.setTopology(given[8]);
        algorithm.setPropagationDirection(given[9]);
        algorithm.setTopologyLUTdirectory(given[10]);
        algorithm.setMinimumDistance(1e-5f); // the default of nighres
        algorithm.execute();
        int[] found = algorithm.getCorrectedObjectImage();
        ByteBuffer bytes = ByteBuffer.allocate(4 * found.length).order(ByteOrder.LITTLE_ENDIAN);
        bytes.asIntBuffer().put(found);
        Files.write(Path.of(given[1]), bytes.array());
    }
}
